"""Read a rerun file as arrow columns, entity by entity."""

from __future__ import annotations

import os
import struct
import tempfile
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from impactlaw.errors import RecordingError
from impactlaw.recording.layout import APPLICATION, STEP

_FILE_HEADER = 12
_MESSAGE_HEADER = struct.Struct("<QQ")  # kind and length of the message


class Entity:
    """The data logged to one entity path.

    Attributes:
        static: the values of each static component.
        columns: the cells of each other component, in the order of frames, as arrow list arrays.
        step: frame of each row.
    """

    def __init__(self, batches: list[Any]):
        import pyarrow as pa

        self.static: dict[str, list[Any]] = {}
        rows = []
        for batch in batches:
            if STEP in batch.schema.names:
                rows.append(batch)
            else:
                self.static |= {name: batch.column(name)[0].as_py() for name in batch.schema.names}
        rows.sort(key=lambda batch: batch.column(STEP)[0].as_py())
        kinds = {field.name: field.type for batch in rows for field in batch.schema}
        self.columns = {
            name: pa.concat_arrays(
                [batch.column(name) if name in batch.schema.names else pa.nulls(len(batch), kind) for batch in rows]
            )
            for name, kind in kinds.items()
        }
        self.step = self.columns.pop(STEP).to_numpy() if rows else np.zeros(0, dtype=np.int64)

    def cells(self, name: str) -> list[Any]:
        """Return the cells of a column, each a list, None if not logged; an empty list without such a column."""
        return self.columns[name].to_pylist() if name in self.columns else []

    def numbers(self, name: str) -> np.ndarray:
        """Return the numbers of a column whose cells have equal lengths, float64, (rows, numbers per cell)."""
        values = self.columns[name]
        while hasattr(values, "flatten") and values.type.num_fields == 1:
            values = values.flatten()
        return values.to_numpy().astype(float).reshape(len(self.step), -1)

    def counts(self, name: str) -> np.ndarray:
        """Return the number of values in each cell of a column."""
        return self.columns[name].value_lengths().to_numpy()


def file_path(path: str | Path) -> Path:
    """Return a path as a `Path`; raise RecordingError if it is neither text nor a path."""
    if not isinstance(path, str | os.PathLike):
        raise RecordingError(f'a recording is a file, such as "run.rrd", got {path!r:.100}')
    return Path(path)


def read_entities(path: Path) -> dict[str, Entity]:
    """Return all entities of a recording; if it was cut off, everything that was written completely."""
    if not path.is_file():
        raise RecordingError(f"{path} is not a file" if path.exists() else f"there is no file {path}")
    if not os.access(path, os.R_OK):
        raise RecordingError(f"no permission to read {path}")
    try:
        chunks = _read_chunks(path, path)
    except RuntimeError:
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / "whole.rrd"
            _copy_whole_messages(path, whole)
            try:
                chunks = _read_chunks(path, whole)
            except RuntimeError:
                raise RecordingError(f"{path} is not a recording: rerun cannot read it") from None
    batches = defaultdict(list)
    for chunk in chunks:
        batches[chunk.entity_path.removeprefix("/")].append(chunk.to_record_batch())
    return {name: Entity(parts) for name, parts in batches.items()}


def _read_chunks(path: Path, file: Path) -> list[Any]:
    from rerun.chunk import RrdReader
    from rerun.error_utils import RerunWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)  # the file of a killed run has no footer
        reader = RrdReader(file)
        entries = reader.recordings()
        own = [entry for entry in entries if entry.application_id == APPLICATION]
        if not own:
            others = ", ".join(entry.application_id for entry in entries) or "nothing"
            raise RecordingError(f"{path} is not a recording of {APPLICATION} but of {others}")
        return reader.stream(store=own[0]).to_chunks()


def _copy_whole_messages(path: Path, target: Path) -> None:
    """Copy a file up to its last complete message, since rerun cannot read a file that ends within a message."""
    size = path.stat().st_size
    with path.open("rb") as source, target.open("wb") as copy:
        copy.write(source.read(_FILE_HEADER))
        while source.tell() + _MESSAGE_HEADER.size <= size:
            header = source.read(_MESSAGE_HEADER.size)
            _, length = _MESSAGE_HEADER.unpack(header)
            if source.tell() + length > size:
                break
            copy.write(header + source.read(length))
