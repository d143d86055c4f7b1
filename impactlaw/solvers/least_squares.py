"""Linear least squares of least norm, by singular values: right for dependent gradients too."""

from __future__ import annotations

import numpy as np

from impactlaw import deferred


def least_squares(A: np.ndarray, b: np.ndarray, rank: float | None = None) -> np.ndarray:
    """Return ``argmin |x|`` over the minimisers of ``|A x - b|``, with one step of iterative refinement.

    Args:
        A: shape (m, n).
        b: shape (m,).
        rank: relative singular value below which a direction counts as absent; rounding if None.
    """
    x = deferred.lstsq(A, b, cond=rank, check_finite=False)[0]
    return x + deferred.lstsq(A, b - A.dot(x), cond=rank, check_finite=False)[0]
