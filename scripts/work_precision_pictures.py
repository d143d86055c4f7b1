"""Pictures of work and precision on log-log axes: run time to the right, error upwards; the lower left is better."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from work_precision_results import envelope, where
from work_precision_stepping import DEFAULT, LOCATED, TIME_STEPPING, TUNED

STYLES = {
    LOCATED: ("#0072B2", "o", "-"),
    "event-driven Euler": ("#56B4E9", "s", "-"),
    TIME_STEPPING: ("#009E73", "D", "-"),
    "soft layer": ("#E69F00", "^", "--"),
    TUNED: ("#D55E00", "v", "-"),
    DEFAULT: ("#000000", "x", ":"),
}
"""Colour (distinguishable by the colour-blind), marker and line of each family of methods."""
COMPACT = ("bouncing ball", "cradle, Moreau", "rod with friction", "quadruped")
"""Scenes of the README's picture."""
_SOLVERS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
_LEAST = 1e-17  # errors of exactly zero are drawn here
_MOST = 10.0  # errors from here on, of simulations that have gone astray, are not drawn


def draw_stepping(table: pd.DataFrame, path: Path, footer: str) -> None:
    """Draw one panel per scene: every family of methods as the envelope of its runs, the runs themselves faintly."""
    scenes = list(dict.fromkeys(table.scene))
    columns = min(3, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = _figure((4.4 * columns, 3.3 * rows + 1.1))
    figure.suptitle("Error of the trajectory against run time of the simulation, timesteps 0.1 s to 1e-5 s")
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axis, scene in zip(axes.flat, scenes, strict=False):
        _draw_scene(axis, where(table, table.scene == scene))
        axis.set_title(scene, loc="left", fontsize=11)
    for axis in axes.flat[len(scenes) :]:
        axis.set_visible(False)
    for axis in axes[:, 0]:
        axis.set_ylabel("distance from the reference's\ngraph in (t, q), scaled")
    for axis in axes[-1]:
        axis.set_xlabel("run time (processor), s")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, borderaxespad=1.6)
    _finish(figure, path, footer, dpi=110)


def draw_compact(table: pd.DataFrame, path: Path, footer: str) -> None:
    """Draw four scenes: the picture of the README, to be read at a width of 800 pixels."""
    scenes = [scene for scene in COMPACT if scene in set(table.scene)]
    rows = -(-len(scenes) // 2)
    figure = _figure((9.0, 3.1 * rows + 1.2))
    figure.suptitle("Error of the trajectory against run time of the simulation", fontsize=13)
    axes = figure.subplots(rows, 2, sharey="row", squeeze=False)
    for axis, scene in zip(axes.flat, scenes, strict=False):
        _draw_scene(axis, where(table, table.scene == scene))
        axis.set_title(scene, loc="left", fontsize=12)
        axis.tick_params(labelsize=10)
    for axis in axes.flat[len(scenes) :]:
        axis.set_visible(False)
    for row in range(rows):
        _limit(axes[row], where(table, table.scene.isin(scenes[2 * row : 2 * row + 2])))
        axes[row, 0].set_ylabel("distance from the exact\ngraph in (t, q), scaled", fontsize=11)
    for axis in axes[-1]:
        axis.set_xlabel("run time (processor), s", fontsize=11)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=11, borderaxespad=1.6)
    _finish(figure, path, footer, dpi=90)


def _limit(axes: Any, table: pd.DataFrame) -> None:
    """Let the axes of a row begin at a power of ten below the least error."""
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
    axis.set_ylim(1e-17, _MOST)
    axis.set_yticks(10.0 ** np.arange(-16, 1, 4))
    axis.grid(alpha=0.3)


def draw_solvers(table: pd.DataFrame, family: str, path: Path, footer: str) -> None:
    """Draw one column per size; residual above, error of energy below; a line joins a solver's condition numbers."""
    chosen = where(table, (table.family == family) & (table.contacts > 1))
    sizes = sorted(set(chosen.contacts))
    figure = _figure((3.6 * len(sizes) + 0.4, 6.6))
    of = "Y, random" if family == "dense" else "the mass matrix, chain of balls"
    figure.suptitle(
        f"Error against time per impact, h contacts at once\ncondition of {of}: 1 (small marker) to 1e12 (large)",
        fontsize=11,
    )
    axes = figure.subplots(2, len(sizes), sharex="col", sharey=True, squeeze=False)
    names = list(dict.fromkeys(_solver_names(chosen)))
    for column, h in enumerate(sizes):
        for row, quantity in enumerate(("residual", "energy_error")):
            axis = axes[row, column]
            _draw_size(axis, where(chosen, chosen.contacts == h), names, quantity)
            axis.set_ylim(_LEAST / 3, 10)
            axis.grid(alpha=0.3)
        middle = np.log10(where(chosen, chosen.contacts == h).seconds)
        axes[0, column].set_xlim(10 ** np.floor(middle.min() - 0.3), 10 ** np.ceil(middle.max() + 0.3))
        axes[0, column].set_title(f"h = {h}", loc="left")
        axes[1, column].set_xlabel("time per impact, s")
    axes[0, 0].set_ylabel("residual, relative")
    axes[1, 0].set_ylabel("energy error, part of T-")
    handles = [
        figure.axes[0].plot([], [], "o-", color=_SOLVERS[i % len(_SOLVERS)], label=name)[0]
        for i, name in enumerate(names)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    _finish(figure, path, footer, dpi=110)


def _draw_size(axis: Any, table: pd.DataFrame, names: list[str], quantity: str) -> None:
    """Draw each solver over the condition numbers, and an iterative one over its settings, per condition number."""
    for i, name in enumerate(names):
        own = where(table, (_solver_names(table) == name) & np.isfinite(table[quantity]))
        color = _SOLVERS[i % len(_SOLVERS)]
        settings = own.setting != ""
        lines = [where(own, ~settings)] + [
            where(own, settings & (own.condition == condition)) for condition in sorted(set(own.condition))
        ]
        for line in lines:
            axis.loglog(line.seconds, line[quantity].clip(_LEAST), "-", color=color, linewidth=1, alpha=0.6)
        sizes = 12 + 5 * np.log10(own.condition)
        axis.scatter(own.seconds, own[quantity].clip(_LEAST), s=sizes, color=color, zorder=3)


def _solver_names(table: pd.DataFrame) -> Any:
    return table.solver + np.where(table.data == "sparse", ", sparse data", "")


def _figure(size: tuple[float, float]) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _finish(figure: Any, path: Path, footer: str, *, dpi: int) -> None:
    height = 0.18 / figure.get_figheight()
    figure.get_layout_engine().set(rect=(0, height, 1, 1 - height))
    figure.text(0.995, 0.3 * height, footer, fontsize=6.5, color="0.35", ha="right")
    figure.savefig(path, dpi=dpi)
