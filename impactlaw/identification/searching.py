"""The search for the parameters of a family whose predictions fit best, by least squares within bounds."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import prod
from typing import Any

import numpy as np
from tqdm import tqdm

from impactlaw.identification.families import Family

_SOLVED = 1e-16  # squared error per collision that needs no further search
_LIMIT = 1e-6  # least distance of initial values from bounds
_MOST_STARTS = 256  # most combinations of initial values that are tried: enough for eight contacts
SOON = 1.0  # s: a search that ends sooner shows no progress, nor do folds
_COMMON: dict[str, Any] = {"x_scale": 0.1, "gtol": 1e-12}
# most steps of a search, each with a derivative; searches that converge take fewer
_THOROUGH: dict[str, Any] = _COMMON | {"max_nfev": 30, "xtol": 1e-12, "ftol": 1e-14}
# where there are local minima: rough searches from several starts, of which only the best one is followed to its end.
# Predictions that are integrated in time are known to 1e-10: closer differences and smaller steps would be noise.
_ROUGH: dict[str, Any] = _COMMON | {"max_nfev": 8, "xtol": 1e-3, "ftol": 1e-2, "diff_step": 1e-6}
_LAST: dict[str, Any] = _COMMON | {
    "max_nfev": 30, "xtol": 1e-10, "ftol": 1e-12, "diff_step": 1e-6, "method": "dogbox",
}  # fmt: skip

Residual = Callable[[np.ndarray], np.ndarray]
"""The errors of all collisions, one after the other, as a function of the parameters."""


def best_parameters(residual: Residual, family: Family, collisions: int) -> np.ndarray:
    """Return the parameters of a family with the least sum of squared errors; a bar tells the trials so far.

    Args:
        residual: function of the parameters that returns the errors.
        family: the family, with bounds and initial values.
        collisions: number of collisions.
    """
    from scipy.optimize import least_squares

    low, high = np.array([(p.low, p.high) for p in family.parameters]).T
    with tqdm(desc=f"fitting {family.name}", unit=" trials", leave=False, delay=SOON, disable=None) as bar:

        def errors(x: np.ndarray) -> np.ndarray:
            bar.update()
            return residual(x)

        def search(start: np.ndarray, options: dict[str, Any]) -> Any:
            return least_squares(errors, start, bounds=(low, high), **options)

        starts = [np.clip(start, low + _LIMIT, high - _LIMIT) for start in _starts(family)]
        costs = [np.sum(errors(start) ** 2) for start in starts] if len(starts) > 1 else [0.0]
        likely, searches = [starts[i] for i in np.argsort(costs, kind="stable")[: family.searches]], []
        if len(likely) == 1:
            return _at_bounds(search(likely[0], _THOROUGH).x, low, high, errors)
        for start in likely:
            searches.append(search(start, _ROUGH))
            if searches[-1].cost < _SOLVED * collisions:
                break
        best = min(searches, key=lambda found: found.cost)
        return _at_bounds(search(best.x, _LAST).x, low, high, errors)


def _starts(family: Family) -> list[tuple[float, ...]]:
    """Return initial values for searches: all combinations or, if these are too many, the k-th value of each."""
    each = [p.starts for p in family.parameters]
    if prod(map(len, each)) <= _MOST_STARTS:
        return list(product(*each))
    return [tuple(starts[k % len(starts)] for starts in each) for k in range(max(map(len, each)))]


def _at_bounds(x: np.ndarray, low: np.ndarray, high: np.ndarray, residual: Residual) -> np.ndarray:
    """Return x with numbers that stopped just before a bound moved to the bound, if that is not worse."""
    moved = np.where(high - x < 1e-6, high, np.where(x - low < 1e-6, low, x))
    if np.array_equal(moved, x):
        return x
    return moved if np.sum(residual(moved) ** 2) <= np.sum(residual(x) ** 2) * (1 + 1e-9) + 1e-24 else x
