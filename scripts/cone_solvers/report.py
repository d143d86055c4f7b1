"""The study's tables: by solver, and by scene for ours; as text on the screen, as files in full."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .solvers import COMPILED

SOLVED, SHARP = 1e-8, 1e-10
"""Natural maps up to which a problem counts as solved: for a simulation, and as our solver aims at."""
_PERCENT, _TINY = {"<= 1e-8 %", "<= 1e-10 %"}, {"worst", "worst from rest"}
Rows = list[dict[str, Any]]


def by_solver(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per solver and start.

    Columns: n, problems that it gets; the shares of them with a natural map up to 1e-8 and 1e-10; processor time, us;
    iterations; and the median time, us, that our own solver takes for the same problems from the same start.
    """
    rows = _rows(table)
    ours = {(row["problem"], row["start"]): row["us"] for row in rows if row["solver"] == COMPILED}
    found = []
    for (solver, start), group in _grouped(rows, "solver", "start").items():
        missed, spent, taken = (_values(group, name) for name in ("missed", "us", "iterations"))
        found.append({
            "solver": solver, "start": start, "n": len(group),
            "<= 1e-8 %": 100.0 * np.mean(missed <= SOLVED), "<= 1e-10 %": 100.0 * np.mean(missed <= SHARP),
            "us p50": np.percentile(spent, 50), "p90": np.percentile(spent, 90), "p99": np.percentile(spent, 99),
            "max": spent.max(), "iterations p50": np.percentile(taken, 50), "its max": taken.max(),
            "ours us p50": np.median([ours[row["problem"], start] for row in group]),
        })  # fmt: skip
    return pd.DataFrame(found)


def by_scene(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per scene about our solver: from the guess, and where it says so from rest.

    Columns: n; rows of the problems; shares of problems with a singular Delassus matrix, and with sliding; processor
    time, us; unsolved, problems with a natural map above 1e-10; worst, the largest one.
    """
    found = []
    for (scene,), group in _grouped([row for row in _rows(table) if row["solver"] == COMPILED], "scene").items():
        guess, rest = ([row for row in group if row["start"] == start] for start in ("guess", "rest"))
        size, spent = _values(guess, "rows"), _values(guess, "us")
        missed, from_rest = _values(guess, "missed"), _values(rest, "missed")
        found.append({
            "scene": scene, "n": len(guess), "rows p50": np.median(size), "rows max": size.max(),
            "singular %": 100.0 * _values(guess, "singular").mean(),
            "sliding %": 100.0 * _values(guess, "slides").mean(), "us p50": np.median(spent), "us max": spent.max(),
            "unsolved": np.count_nonzero(missed > SHARP), "from rest": np.count_nonzero(from_rest > SHARP),
            "worst": missed.max(), "worst from rest": from_rest.max(),
        })  # fmt: skip
    return pd.DataFrame(found)


def show(table: pd.DataFrame) -> str:
    """Return both tables as text."""
    return "\n".join([_text(by_solver(table)), "", f"{COMPILED}, scene by scene", _text(by_scene(table))])


def write(table: pd.DataFrame, folder: Path) -> None:
    """Write all rows and both tables as CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "problems.csv", index=False)
    by_solver(table).to_csv(folder / "by_solver.csv", index=False)
    by_scene(table).to_csv(folder / "by_scene.csv", index=False)


def _rows(table: pd.DataFrame) -> Rows:
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]


def _grouped(rows: Rows, *names: str) -> dict[tuple[Any, ...], Rows]:
    """Return the rows by their entries under these names, in the order in which these come."""
    groups: dict[tuple[Any, ...], Rows] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return groups


def _values(rows: Rows, name: str) -> np.ndarray:
    return np.array([row[name] for row in rows], float)


def _text(table: pd.DataFrame) -> str:
    shown = {str(name): [_cell(str(name), value) for value in column] for name, column in table.items()}
    return pd.DataFrame(shown).to_string(index=False)


def _cell(name: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    if name in _TINY:
        return f"{value:.0e}"
    return f"{value:.1f}" if name in _PERCENT or (value < 10.0 and value != round(value)) else f"{value:.0f}"
