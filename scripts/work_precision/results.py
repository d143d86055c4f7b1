"""Results from a work-precision table: measured orders, lower envelopes, errors at equal run time."""

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from .scenes import EXACT, SCENES
from .stepping import LOCATED, TIME_STEPPING

_FLOOR = 2e-11  # smaller errors come from the gap tolerance and from rounding
_ROUNDING = 1e-12  # largest error of a method that counts as exact


def where(table: pd.DataFrame, rows: ArrayLike) -> pd.DataFrame:
    """Return the rows of a table where a condition holds."""
    return table.loc[np.asarray(rows, dtype=bool)]


def orders(table: pd.DataFrame) -> pd.DataFrame:
    """Return the measured order of each method on each scene beside the expected one.

    The measured order is the least-squares slope of log(error) over log(timestep), for timesteps up to the scene's
    coarsest and errors above 2e-11, in (t, q) and in (t, q, v); the expected order is for (t, q). A method that
    integrates a scene exactly has no order, but its smallest and largest errors are listed.
    """
    rows = []
    for scene, method in dict.fromkeys(zip(table.scene, table.method, strict=True)):
        group = where(table, (table.scene == scene) & (table.method == method))
        used = where(
            group, (group.timestep <= SCENES[scene].coarsest) & (group.error > _FLOOR) & np.isfinite(group.error)
        )
        measured, with_v = (
            np.polyfit(np.log(used.timestep), np.log(used[error]), 1)[0] if len(used) >= 2 else np.nan
            for error in ("error", "error_qv")
        )
        expected = group.expected_order.iloc[0]
        exact = expected == EXACT and bool((group.error <= _ROUNDING).all())
        row = {"scene": scene, "method": method, "expected": expected}
        row |= {"measured": np.nan if exact else measured, "with velocities": np.nan if exact else with_v}
        row |= {"timesteps": len(used), "smallest error": group.error.min(), "largest error": group.error.max()}
        rows.append(row | {"reference error": group.reference_error.iloc[0]})
    return pd.DataFrame(rows)


def envelope(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the best runs, by increasing run time: each has a smaller error than all faster runs."""
    ordered = where(runs, np.isfinite(runs.error)).sort_values("seconds")
    best = ordered.error.cummin()
    return where(ordered, (ordered.error <= best) & ~best.duplicated())


def error_at(runs: pd.DataFrame, seconds: np.ndarray) -> np.ndarray:
    """Return the error of the envelope at these run times, (n,), by log-log interpolation between its runs."""
    best = envelope(runs)
    return np.exp(np.interp(np.log(seconds), np.log(best.seconds), np.log(best.error)))


def advantage(table: pd.DataFrame) -> pd.DataFrame:
    """Return, per scene and way of rigid stepping, the ratio of MuJoCo's smallest error to its own at equal run time.

    MuJoCo's error is the envelope over all of its contacts, tuned or not, with every integrator and timestep. Run times
    are those of the rigid runs, up to MuJoCo's longest run. Columns: run time (s), the two errors and the ratio where
    the ratio is largest; the smallest ratio; and the run time up to which MuJoCo is more accurate, s, empty where it
    never is.
    """
    rows = []
    for scene in dict.fromkeys(table.scene):
        group = where(table, table.scene == scene)
        theirs = where(group, group.method.str.startswith("MuJoCo") & np.isfinite(group.error))
        for method in (LOCATED, TIME_STEPPING):
            ours = envelope(where(group, group.method == method))
            ours = where(ours, ours.seconds <= theirs.seconds.max())
            if len(ours) == 0 or len(theirs) == 0:
                continue
            least = error_at(theirs, ours.seconds.to_numpy())
            ratio = least / ours.error.to_numpy()
            top, behind = int(np.argmax(ratio)), np.flatnonzero(ratio < 1)
            row = {"scene": scene, "method": method, "run time": ours.seconds.iloc[top]}
            row |= {"error": ours.error.iloc[top], "MuJoCo's best": least[top], "ratio": ratio[top]}
            nearer = ours.seconds.iloc[behind[-1]] if len(behind) else np.nan
            rows.append(row | {"smallest ratio": ratio.min(), "MuJoCo nearer up to": nearer})
    return pd.DataFrame(rows)
