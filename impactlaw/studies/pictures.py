"""Draw a transfer matrix: scores, and beside them regrets if there is more than one policy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from impactlaw.comparison.pictures import plain
from impactlaw.studies.transfer import TransferMatrix

_CELL = 1.15, 0.62  # width and height of an entry, inches
_MARGIN = 0.9  # room for the axis label and the title, inches


def draw(matrix: TransferMatrix, path: Path) -> None:
    """Write the picture as a PNG file."""
    from matplotlib.figure import Figure

    shown, (rows, columns) = matrix.shown(), matrix.score.shape
    beside = 0.085 * max(len(str(name)) for name in matrix.score.index)  # approximate length of names, inches
    below = 0.065 * max(len(str(name)) for name in matrix.score.columns)
    width = len(shown) * max(columns * _CELL[0], 3.2) + beside + 2 * _MARGIN
    figure = Figure(figsize=(width, rows * _CELL[1] + below + 2 * _MARGIN), layout="constrained")
    figure.suptitle(plain(matrix.title()), fontsize=11)
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    _panel(panels[0], matrix.score, shown["score"], "score", "viridis")
    if "regret" in shown:
        _panel(panels[1], matrix.regret, shown["regret"], "regret: best of the column less the score", "YlOrRd")
    panels[0].set_ylabel("policy made for")
    figure.savefig(path, dpi=130, bbox_inches="tight", pad_inches=0.1)


def _panel(axes: Any, value: pd.DataFrame, shown: pd.DataFrame, title: str, colors: str) -> None:
    numbers = value.to_numpy()
    image = axes.imshow(numbers, cmap=colors, aspect="auto")
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("acted under")
    below, beside = ([plain(str(name)) for name in names] for names in (value.columns, value.index))
    axes.set_xticks(range(len(below)), below, rotation=30, ha="right", rotation_mode="anchor", fontsize=9)
    axes.set_yticks(range(len(beside)), beside, fontsize=9)
    for i, j in np.ndindex(*numbers.shape):
        color = image.cmap(image.norm(numbers[i, j]))
        dark = np.dot(color[:3], (0.299, 0.587, 0.114)) < 0.5
        text = shown.iloc[i, j].replace(" ± ", "\n± ")
        axes.text(j, i, text, ha="center", va="center", fontsize=9, color="white" if dark else "black")
