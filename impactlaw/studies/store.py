"""The folder of a study: finished cells and trained policies, in files that are either complete or absent."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from impactlaw.errors import StudyError


class Store:
    """A store of results by their keys.

    ``cells/<key>.json`` holds settings and row of a cell, ``policies/<key>.zip`` a trained policy with its settings
    beside it in ``policies/<key>.json``. Files are written under another name and then renamed, so that a kill at any
    moment leaves no incomplete file.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def make(self) -> None:
        """Create the folder if it does not exist.

        Raises:
            StudyError: the folder cannot be created.
        """
        try:
            for name in ("cells", "policies"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StudyError(f"cannot write into {self.folder}: {error.strerror}") from None

    def row(self, key: str) -> dict[str, Any] | None:
        """Return the row of a finished cell, or None."""
        path = self.folder / "cells" / f"{key}.json"
        if not path.exists():
            return None
        try:
            row = json.loads(path.read_text(encoding="utf-8"))["row"]
            if not isinstance(row, dict):
                raise TypeError("its row has no names")
            return row
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StudyError(f"{path} is not a cell of a study ({error}); remove it, and it is made again") from None

    def keep_row(self, key: str, settings: dict[str, Any], row: dict[str, Any]) -> None:
        """Write a finished cell."""
        write(self.folder / "cells" / f"{key}.json", _json({"settings": settings, "row": row}))

    def policy(self, key: str) -> Path | None:
        """Return the file of a trained policy, or None."""
        path = self.folder / "policies" / f"{key}.zip"
        return path if path.exists() else None

    def keep_policy(self, key: str, settings: dict[str, Any], content: bytes) -> None:
        """Write a trained policy with its settings beside it; the policy is written last."""
        write(self.folder / "policies" / f"{key}.json", _json(settings))
        write(self.folder / "policies" / f"{key}.zip", content)


def write(path: Path, content: bytes) -> None:
    """Write a file so that it is either complete or absent."""
    unfinished = path.with_name(f".unfinished-{os.getpid()}-{path.name}")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(path)
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror}") from None
    finally:
        with suppress(OSError):
            unfinished.unlink()


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode()
