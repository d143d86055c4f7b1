"""Columns as rerun's ``send_columns`` takes them, with exact arrow types."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlaw.recording.layout import SIM_TIME, STEP, cell_type


class Column:
    """One column of own values; rerun's own ``AnyValues`` would drop an empty one.

    Args:
        name: ``"archetype:component"``.
        kind: see `impactlaw.recording.layout.cell_type`; plural when a cell is a sequence.
        cells: one per row; None leaves it empty.
    """

    def __init__(self, name: str, kind: str, cells: Sequence[Any] | np.ndarray):
        import pyarrow as pa

        rows = [[] if cell is None else cell if kind.endswith("s") else [cell] for cell in cells]
        self._name = name
        self._array = pa.array(rows, pa.list_(cell_type(kind)))

    def component_descriptor(self) -> Any:
        """Return rerun's description of the column."""
        import rerun as rr

        return rr.ComponentDescriptor(self._name, archetype=self._name.partition(":")[0])

    def as_arrow_array(self) -> Any:
        """Return the cells."""
        return self._array


def time_columns(clock: Sequence[float] | np.ndarray, step: Sequence[int] | np.ndarray) -> list[Any]:
    """Return the two timelines of rows at these times, in s, and frames."""
    import rerun as rr

    nanoseconds = np.rint(1e9 * np.asarray(clock, dtype=float)).astype("timedelta64[ns]")
    return [rr.TimeColumn(SIM_TIME, duration=nanoseconds), rr.TimeColumn(STEP, sequence=np.asarray(step))]
