"""Tables of the study, by solver and, for our solver, by scene: as text on the screen, and in full as files."""

from pathlib import Path
from typing import Any

import pandas as pd

from scripts import machine

from .solvers import COMPILED

SOLVED, SHARP = 1e-8, 1e-10
"""Natural maps up to which a problem counts as solved: well enough for a simulation, and as our solver aims at."""


def by_solver(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per solver and start.

    Columns: n, number of problems that it gets; the percentages with a natural map up to 1e-8 and 1e-10; processor
    time, us; iterations; and the median time, us, of our own solver for the same problems from the same start.
    """
    own = table.loc[table.solver == COMPILED].set_index(["problem", "start"]).us
    told = table.assign(
        ours=own.reindex(pd.MultiIndex.from_arrays([table.problem, table.start])).to_numpy(),
        solved=100.0 * (table.missed <= SOLVED),
        sharp=100.0 * (table.missed <= SHARP),
    )
    columns: dict[str, Any] = {"n": ("us", "size"), "<= 1e-8 %": ("solved", "mean"), "<= 1e-10 %": ("sharp", "mean")}
    columns |= {"us p50": ("us", "median")}
    columns |= {f"p{q}": ("us", lambda us, q=q: us.quantile(q / 100)) for q in (90, 99)} | {"max": ("us", "max")}
    columns |= {"iterations p50": ("iterations", "median"), "its max": ("iterations", "max")}
    columns |= {"ours us p50": ("ours", "median")}
    return told.groupby(["solver", "start"], sort=False).agg(**columns).reset_index()


def by_scene(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scene about our solver, started from the guess, or from rest where a column says so.

    Columns: n; rows of the problems; percentages of problems with a singular Delassus matrix, and with sliding;
    processor time, us; unsolved, number of problems with a natural map above 1e-10; worst, the largest natural map.
    """
    own = table.loc[table.solver == COMPILED].assign(
        above=lambda own: own.missed > SHARP, singular=100.0 * table.singular, slides=100.0 * table.slides
    )
    rest = own.loc[own.start == "rest", ["problem", "missed", "above"]]
    told = own.loc[own.start == "guess"].merge(rest, on="problem", suffixes=("", "_rest"))
    columns: dict[str, Any] = {"n": ("us", "size"), "rows p50": ("rows", "median"), "rows max": ("rows", "max")}
    columns |= {"singular %": ("singular", "mean"), "sliding %": ("slides", "mean")}
    columns |= {"us p50": ("us", "median"), "us max": ("us", "max")}
    columns |= {"unsolved": ("above", "sum"), "from rest": ("above_rest", "sum")}
    columns |= {"worst": ("missed", "max"), "worst from rest": ("missed_rest", "max")}
    return told.groupby("scene", sort=False).agg(**columns).reset_index()


def show(table: pd.DataFrame) -> str:
    """Return both tables as text."""
    return "\n".join([_text(by_solver(table)), "", f"{COMPILED}, scene by scene", _text(by_scene(table))])


def write(table: pd.DataFrame, folder: Path) -> None:
    """Write all rows and both tables as CSV, and the machine beside them."""
    machine.write({"problems": table, "by_solver": by_solver(table), "by_scene": by_scene(table)}, folder)


def _text(table: pd.DataFrame) -> str:
    special: dict[Any, Any] = dict.fromkeys(("<= 1e-8 %", "<= 1e-10 %"), "{:.1f}".format)
    special |= dict.fromkeys(("worst", "worst from rest"), "{:.0e}".format)
    return table.to_string(index=False, formatters=special, float_format=_number)


def _number(x: float) -> str:
    return f"{x:.1f}" if x < 10.0 and x != round(x) else f"{x:.0f}"
