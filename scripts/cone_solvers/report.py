"""Tables of the study, by solver and, for our solver, by scene: as text on the screen, and in full as files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from .solvers import COMPILED

SOLVED, SHARP = 1e-8, 1e-10
"""Natural maps up to which a problem counts as solved: well enough for a simulation, and as our solver aims at."""
_PERCENT, _TINY = {"<= 1e-8 %", "<= 1e-10 %"}, {"worst", "worst from rest"}


def _share(limit: float) -> Callable[[pd.Series], float]:
    return lambda missed: 100.0 * float((missed <= limit).mean())


def _above(missed: pd.Series) -> int:
    return int((missed > SHARP).sum())


def _percent(values: pd.Series) -> float:
    return 100.0 * float(values.mean())


def by_solver(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per solver and start.

    Columns: n, number of problems that it gets; the percentages with a natural map up to 1e-8 and 1e-10; processor
    time, us; iterations; and the median time, us, of our own solver for the same problems from the same start.
    """
    own = table.loc[table.solver == COMPILED].set_index(["problem", "start"]).us
    told = table.assign(ours=own.reindex(pd.MultiIndex.from_arrays([table.problem, table.start])).to_numpy())
    columns: dict[str, Any] = {"n": ("us", "size")}
    columns |= {"<= 1e-8 %": ("missed", _share(SOLVED)), "<= 1e-10 %": ("missed", _share(SHARP))}
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
    own = table.loc[table.solver == COMPILED]
    rest = own.loc[own.start == "rest"].set_index("problem").missed
    told = own.loc[own.start == "guess"].assign(rest=lambda own: rest.reindex(own.problem).to_numpy())
    columns: dict[str, Any] = {"n": ("us", "size"), "rows p50": ("rows", "median"), "rows max": ("rows", "max")}
    columns |= {"singular %": ("singular", _percent), "sliding %": ("slides", _percent)}
    columns |= {"us p50": ("us", "median"), "us max": ("us", "max")}
    columns |= {"unsolved": ("missed", _above), "from rest": ("rest", _above)}
    columns |= {"worst": ("missed", "max"), "worst from rest": ("rest", "max")}
    return told.groupby("scene", sort=False).agg(**columns).reset_index()


def show(table: pd.DataFrame) -> str:
    """Return both tables as text."""
    return "\n".join([_text(by_solver(table)), "", f"{COMPILED}, scene by scene", _text(by_scene(table))])


def write(table: pd.DataFrame, folder: Path) -> None:
    """Write all rows and both tables as CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "problems.csv", index=False)
    by_solver(table).to_csv(folder / "by_solver.csv", index=False)
    by_scene(table).to_csv(folder / "by_scene.csv", index=False)


def _text(table: pd.DataFrame) -> str:
    shown = {str(name): [_cell(str(name), value) for value in column] for name, column in table.items()}
    return pd.DataFrame(shown).to_string(index=False)


def _cell(name: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    if name in _TINY:
        return f"{value:.0e}"
    return f"{value:.1f}" if name in _PERCENT or (value < 10.0 and value != round(value)) else f"{value:.0f}"
