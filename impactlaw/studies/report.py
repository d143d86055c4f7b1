"""Write the readable results of a study: tables and pictures of its transfer matrices."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd

from impactlaw.errors import StudyError
from impactlaw.studies.pictures import draw
from impactlaw.studies.transfer import transfer_matrices


def report(table: pd.DataFrame, folder: Path) -> str:
    """Write ``transfer.md``, ``transfer.csv`` and a picture per matrix, and return the matrices as text to print."""
    matrices = list(transfer_matrices(table))
    try:
        (folder / "transfer.md").write_text("\n".join(m.to_markdown() for m in matrices), encoding="utf-8")
        pd.concat([m.to_frame() for m in matrices]).to_csv(folder / "transfer.csv", index=False)
        pictures = [re.sub("[/:]", "-", f"{matrix.task}-{matrix.scheme}.png") for matrix in matrices]
        for matrix, name in zip(matrices, pictures, strict=True):
            draw(matrix, folder / name)
    except OSError as error:
        raise StudyError(f"cannot write into {folder}: {error.strerror}") from None
    text = "\n\n".join(map(str, matrices))
    return f"{text}\n\nin {folder}: table.parquet, transfer.csv, transfer.md, {', '.join(pictures)}"
