"""Least squares of least norm and the span of rows, by singular values: right for dependent gradients too."""

from __future__ import annotations

import numpy as np
import scipy


def least_squares(A: np.ndarray, b: np.ndarray, rank: float | None = None) -> np.ndarray:
    """Return ``argmin |x|`` over the minimisers of ``|A x - b|``, (n,), with one step of iterative refinement.

    Directions of a relative singular value below ``rank`` count as absent; below rounding if None.
    """
    x = scipy.linalg.lstsq(A, b, cond=rank, check_finite=False)[0]
    return x + scipy.linalg.lstsq(A, b - A @ x, cond=rank, check_finite=False)[0]


def row_span(rows: np.ndarray, rank: float) -> tuple[np.ndarray, np.ndarray]:
    """Return an orthonormal basis of the span of rows, (r, n), and the C with ``basis = C @ rows``, (r, m).

    They are dependent below the singular value ``rank`` of rows of unit length, relative to the largest.
    """
    lengths = np.sqrt(np.vecdot(rows, rows))
    lengths[lengths == 0] = 1.0
    U, s, V = np.linalg.svd(rows / lengths[:, None], full_matrices=False)
    r = np.count_nonzero(s > rank * s.max(initial=0.0))
    return V[:r], (U[:, :r] / s[:r]).T / lengths
