"""Work-precision diagrams on log-log axes: run time to the right, error upwards; the lower left is better."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .results import envelope, where
from .stepping import DEFAULT, LOCATED, TIME_STEPPING, TUNED

STYLES = {
    LOCATED: ("#0072B2", "o", "-"),
    "event-driven Euler": ("#56B4E9", "s", "-"),
    TIME_STEPPING: ("#009E73", "D", "-"),
    "soft layer": ("#E69F00", "^", "--"),
    TUNED: ("#D55E00", "v", "-"),
    DEFAULT: ("#000000", "x", ":"),
}
"""Color (distinguishable by the color-blind), marker and line of each family of methods."""
COMPACT = ("bouncing ball", "cradle, Moreau", "rod with friction", "quadruped")
"""Scenes of the README's picture."""
_COLUMNS, _SIZE = 2, 12  # panels beside each other; font size, points
_LEAST = 1e-17  # errors of exactly zero are drawn here
_MOST = 10.0  # larger errors, of simulations that have gone astray, are not drawn


def draw(table: pd.DataFrame, path: Path, footer: str) -> None:
    """Draw one panel per scene, two beside each other, readable at a width of 800 pixels.

    Every family of methods is drawn as the envelope of its runs, with the runs themselves as faint marks.
    """
    from matplotlib.figure import Figure

    scenes = tuple(dict.fromkeys(table.scene))
    rows = -(-len(scenes) // _COLUMNS)
    figure: Any = Figure(figsize=(4.5 * _COLUMNS, 3.1 * rows + 1.2), layout="constrained")
    figure.suptitle("Error of the trajectory against run time of the simulation", fontsize=_SIZE + 1)
    axes = figure.subplots(rows, _COLUMNS, sharey="row", squeeze=False)
    for axis, scene in zip(axes.flat, scenes, strict=False):
        _draw_scene(axis, where(table, table.scene == scene))
        axis.set_title(scene, loc="left", fontsize=_SIZE)
        axis.tick_params(labelsize=_SIZE - 2)
    for axis in axes.flat[len(scenes) :]:
        axis.set_visible(False)
    for row, axis in enumerate(axes[:, 0]):
        shown = scenes[_COLUMNS * row : _COLUMNS * (row + 1)]
        _limit(axes[row], where(table, table.scene.isin(shown)))
        axis.set_ylabel("distance from the reference's\ngraph in (t, q), scaled", fontsize=_SIZE - 1)
    for axis in axes[-1]:
        axis.set_xlabel("run time (processor), s", fontsize=_SIZE - 1)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    place = {"loc": "outside lower center", "ncols": 3, "frameon": False, "borderaxespad": 1.6}
    figure.legend(handles, labels, fontsize=_SIZE - 1, **place)
    height = 0.18 / figure.get_figheight()
    figure.get_layout_engine().set(rect=(0, height, 1, 1 - height))
    figure.text(0.995, 0.3 * height, footer, fontsize=6.5, color="0.35", ha="right")
    figure.savefig(path, dpi=90)


def _limit(axes: Any, table: pd.DataFrame) -> None:
    """Set the lower end of the axes of a row to a power of ten below the smallest error."""
    least = float(table.error.clip(_LEAST).min())
    low = 10.0 ** np.floor(np.log10(least) - 0.3)
    step = 4 if low < 1e-10 else 2
    for axis in axes:
        axis.set_ylim(low, _MOST)
        axis.set_yticks(10.0 ** np.arange(0, np.log10(low) - 0.5, -step))


def _draw_scene(axis: Any, table: pd.DataFrame) -> None:
    for family, (color, marker, line) in STYLES.items():
        runs = where(table, (table.family == family) & (table.error < _MOST))
        if len(runs) == 0:
            continue
        best = envelope(runs) if runs.method.nunique() > 1 else runs.sort_values("seconds")
        axis.loglog(runs.seconds, runs.error.clip(_LEAST), marker, color=color, markersize=3, alpha=0.3)
        axis.loglog(best.seconds, best.error.clip(_LEAST), line, marker=marker, color=color, markersize=5, label=family)
    axis.grid(alpha=0.3)
