"""What the study asks of time stepping, goal by goal: met or not, and the worst scenes by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isnan, nan
from typing import Any

import pandas as pd

from .case import CUT, FINE, NO_CONTROLS, NOT_LOADED

MANY = 300
"""Degrees of freedom from which a scene is one where hundreds of bodies collide."""
_WORST = 6
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Goal:
    """One goal: a number of each case, and what it may be at most.

    Attributes:
        name: what is asked.
        value: the number, from the row of a case; nan where the goal does not concern it.
        limit: the largest that is met.
        unit: behind the numbers.
    """

    name: str
    value: Callable[[Row], float]
    limit: float
    unit: str = ""


def _of(column: str) -> Callable[[Row], float]:
    return lambda row: float(row.get(column, nan))


def _if(condition: Callable[[Row], bool], value: Callable[[Row], float]) -> Callable[[Row], float]:
    return lambda row: value(row) if condition(row) else nan


def _many(row: Row) -> bool:
    return row.get("nv", 0) >= MANY


def _few(row: Row) -> bool:
    return not _many(row)


def _beyond(row: Row) -> float:
    return float(row.get("mean_us", nan)) - 2.5 * float(row.get("mj_us", nan))


_FEW, _MANY = f"(below {MANY} degrees of freedom)", f"(from {MANY} degrees of freedom on)"
GOALS = (
    Goal("every case takes all its steps", lambda row: float(row["outcome"] != FINE), 0.0),
    Goal("no step above 20 times the mean", _of("over_mean"), 20.0, "x"),
    Goal("no step above 20 ms", _of("largest_ms"), 20.0, "ms"),
    Goal(f"depth after 100 steps at most 1e-5 m {_FEW}", _if(_few, _of("depth")), 1e-5, "m"),
    Goal(f"depth after 100 steps at most 1e-3 m {_MANY}", _if(_many, _of("depth")), 1e-3, "m"),
    Goal("shortfall below 1e-6 of the speed in 99 % of steps", lambda row: 1.0 - _of("met")(row), 0.01, "of steps"),
    Goal("shortfall never above 1e-2 of the speed", _of("short"), 1e-2),
    Goal(f"mean at most 2.5 mj_step + 120 us {_FEW}", _if(_few, _beyond), 120.0, "us beyond 2.5 mj_step"),
    Goal(f"mean at most 8 mj_step {_MANY}", _if(_many, _of("ratio")), 8.0, "x"),
    Goal("energy of passive scenes grows by at most 1e-6 of its largest", _of("growth"), 1e-6),
)


def cases(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows that are cases: scenes that loaded, and whose controls can be random where they are to be."""
    rows: list[dict[str, Any]] = [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
    return [row for row in rows if row["outcome"] != NO_CONTROLS and not row["outcome"].startswith(NOT_LOADED)]


def verdicts(table: pd.DataFrame, way: str = "time-stepping") -> pd.DataFrame:
    """Return one row per goal.

    Columns: goal; met, "yes", "no", or "-" where nothing was measured; cases and missed, their numbers; worst, the
    scenes that miss it, worst first, with numbers.
    """
    chosen = [row for row in cases(table) if row["way"] == way]
    return pd.DataFrame([_verdict(goal, chosen) for goal in GOALS])


def _verdict(goal: Goal, rows: list[dict[str, Any]]) -> dict[str, object]:
    known = [(row["scene"], value) for row in rows if not isnan(value := goal.value(row))]
    missed = [(scene, value) for scene, value in known if value > goal.limit]
    met = "-" if not known else "no" if missed else "yes"
    worst = _named(missed, goal.unit)
    return {"goal": goal.name, "met": met, "cases": len(known), "missed": len(missed), "worst": worst}


def _named(missed: list[tuple[str, float]], unit: str) -> str:
    worst: dict[str, float] = {}
    for scene, value in sorted(missed, key=lambda pair: -pair[1]):
        worst.setdefault(scene, value)
    named = [f"{scene} {value:.3g}" for scene, value in list(worst.items())[:_WORST]]
    more = f" and {len(worst) - _WORST} scenes more" if len(worst) > _WORST else ""
    return f"{', '.join(named)}{more}{' ' + unit if unit and named else ''}"


def failures(table: pd.DataFrame) -> pd.DataFrame:
    """Return the cases that did not take all their steps, and were not merely out of time."""
    columns = ["scene", "way", "e", "start", "steps", "outcome"]
    return pd.DataFrame([row for row in cases(table) if row["outcome"] not in (FINE, CUT)], columns=columns)
