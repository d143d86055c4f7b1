"""What this package takes from scipy, each imported when it is first used: ``import impactlaw`` does not wait for it.

``deferred.nnls`` is ``scipy.optimize.nnls``; after its first use it is an attribute like any other.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

_HOMES = {
    "scipy.linalg": ("lstsq", "orth", "qr", "solve", "svd"),
    "scipy.linalg.blas": ("dnrm2", "dtrsv"),
    "scipy.linalg.lapack": ("dpbtrf", "dpbtrs", "dposv", "dpotrf", "dpttrf", "dpttrs", "dtrtrs"),
    "scipy.optimize": ("nnls", "root_scalar"),
    "scipy.sparse": ("csc_matrix", "csr_array", "eye_array"),
    "scipy.sparse.csgraph": ("connected_components", "reverse_cuthill_mckee"),
    "scipy.spatial": ("ConvexHull",),
}
HOME = {name: home for home, names in _HOMES.items() for name in names}
ENDED = 1
"""What `unchecked_nnls` says when it has found the minimum."""


def __getattr__(name: str) -> Any:
    """Import a routine and keep it here."""
    if name == "unchecked_nnls":
        globals()[name] = routine = chosen_nnls()
        return routine
    if name not in HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = routine = getattr(import_module(HOME[name]), name)
    return routine


def chosen_nnls() -> Any:
    """Return NNLS that does not check what it is given, ``(A, b, changes) -> (x, |A x - b|, ENDED or not)``.

    For a few contacts scipy's checks take four times as long as the rest. What it then calls has no public name: where
    that is gone, or behaves in another way, `scipy.optimize.nnls` itself takes its place.

    Args of what is returned: ``A`` (m, n) and ``b`` (m,), in double precision, n > 0, and the changes allowed.
    """
    try:
        routine = import_module("scipy.optimize._nnls")._nnls
        found, _, ended = routine(np.array([[2.0]]), np.array([1.0]), 3)
        given_up = routine(np.eye(2), np.ones(2), 1)[2]
    except (ImportError, AttributeError, TypeError, ValueError, RuntimeError):
        return checked_nnls
    return routine if found.tolist() == [0.5] and ended == ENDED != given_up else checked_nnls


def checked_nnls(A: np.ndarray, b: np.ndarray, changes: int) -> tuple[np.ndarray, float, int]:
    """Return what `scipy.optimize.nnls` finds, as `unchecked_nnls` does."""
    try:
        return *__getattr__("nnls")(A, b, maxiter=changes), ENDED
    except RuntimeError:  # its way to say that the changes were not enough
        return np.zeros(A.shape[1]), float(np.linalg.norm(b)), 0


def load_solvers() -> None:
    """Import now what collisions need, so that no step of a simulation waits for it."""
    for name, home in HOME.items():
        if home != "scipy.spatial" and name not in globals():
            __getattr__(name)
    __getattr__("unchecked_nnls")
