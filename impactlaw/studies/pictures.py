"""A transfer matrix as a picture: scores, and beside them regrets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from impactlaw.studies.transfer import TransferMatrix, decimals, entry

_CELL = 1.15, 0.62  # inches
_MARGIN = 0.9  # inches, for the axis' name and the title


def draw(matrix: TransferMatrix, path: Path) -> None:
    """Write the picture as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows, columns = matrix.score.shape
    label = 0.085 * max(map(len, map(str, matrix.score.index)))  # inches, about
    width = 2 * (max(columns, 2) * _CELL[0]) + label + 2 * _MARGIN
    below = 0.065 * max(map(len, map(str, matrix.score.columns)))
    figure = Figure(figsize=(width, max(rows, 2) * _CELL[1] + below + 2 * _MARGIN), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(matrix.title(), fontsize=11)
    left, right = figure.subplots(1, 2, sharey=True)
    digits = decimals(matrix.score.to_numpy())
    _panel(left, matrix.score, matrix.half, "score", "viridis", digits)
    _panel(right, matrix.regret, matrix.regret_half, "regret: best of the column less the score", "YlOrRd", digits)
    left.set_ylabel("policy made for")
    figure.savefig(path, dpi=130)


def _panel(axes: Any, value: pd.DataFrame, half: pd.DataFrame, title: str, colours: str, digits: int) -> None:
    numbers = value.to_numpy()
    image = axes.imshow(numbers, cmap=colours, aspect="auto")
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("acted under")
    axes.set_xticks(range(value.shape[1]), value.columns, rotation=30, ha="right", rotation_mode="anchor", fontsize=9)
    axes.set_yticks(range(value.shape[0]), value.index, fontsize=9)
    for i, j in np.ndindex(*numbers.shape):
        colour = image.cmap(image.norm(numbers[i, j]))
        dark = np.dot(colour[:3], (0.299, 0.587, 0.114)) < 0.5
        text = entry(numbers[i, j], half.iloc[i, j], digits).replace(" ± ", "\n± ")
        axes.text(j, i, text, ha="center", va="center", fontsize=9, color="white" if dark else "black")
