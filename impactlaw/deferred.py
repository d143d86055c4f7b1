"""What this package takes from scipy, each imported when it is first used: ``import impactlaw`` does not wait for it.

``deferred.nnls`` is ``scipy.optimize.nnls``; after its first use it is an attribute like any other.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "scipy.linalg": ("lstsq", "orth", "qr", "solve", "svd"),
    "scipy.linalg.blas": ("dtrsv",),
    "scipy.linalg.lapack": ("dpbtrf", "dpbtrs", "dgesv", "dposv", "dpotrf", "dpttrf", "dpttrs", "dtrtrs"),
    "scipy.optimize": ("nnls", "root_scalar"),
    "scipy.sparse": ("csc_matrix", "csr_array", "eye_array"),
    "scipy.sparse.csgraph": ("connected_components", "reverse_cuthill_mckee"),
    "scipy.spatial": ("ConvexHull",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a routine and keep it here."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = routine = getattr(import_module(_HOME[name]), name)
    return routine


def load_solvers() -> None:
    """Import now what collisions need, so that no step of a simulation waits for it."""
    for name, home in _HOME.items():
        if home != "scipy.spatial" and name not in globals():
            __getattr__(name)
