"""Least squares of least norm and the span of rows, by singular values, also for dependent gradients."""

from __future__ import annotations

import numpy as np
import scipy


def least_squares(A: np.ndarray, b: np.ndarray, rank: float | None = None) -> np.ndarray:
    """Return ``argmin |x|`` over the minimisers of ``|A x - b|``, (n,), with one step of iterative refinement.

    Directions whose relative singular value is below ``rank`` count as absent; if None, below machine precision.
    """
    x = scipy.linalg.lstsq(A, b, cond=rank, check_finite=False)[0]
    return x + scipy.linalg.lstsq(A, b - A @ x, cond=rank, check_finite=False)[0]


def row_span(rows: np.ndarray, rank: float) -> tuple[np.ndarray, np.ndarray]:
    """Return an orthonormal basis of the span of rows, (r, n), and the C with ``basis = C @ rows``, (r, m).

    Directions count as absent if their singular value, of rows of unit length and relative to the largest, is at most
    ``rank``.
    """
    lengths = np.sqrt(np.vecdot(rows, rows))
    lengths[lengths == 0] = 1.0
    U, s, V = np.linalg.svd(rows / lengths[:, None], full_matrices=False)
    r = np.count_nonzero(s > rank * s.max(initial=0.0))
    return V[:r], (U[:, :r] / s[:r]).T / lengths
