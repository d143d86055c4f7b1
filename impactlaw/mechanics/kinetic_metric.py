"""The kinetic metric: norm and inner product of the mass matrix, ``<u, v> = u^T M v``."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from impactlaw.errors import InvalidCollisionError
from impactlaw.mechanics.arrays import finite_array
from impactlaw.mechanics.tolerances import SYMMETRY

_ROW_BY_ROW = 1e5
"""Multiplications up to which rows are solved one by one: for many rows at once the BLAS starts threads, which can cost
milliseconds while another process keeps the cores busy."""


class KineticMetric:
    """The mass matrix and its factor ``M = R R^T``, which turns the kinetic metric into the Euclidean one.

    ``whiten(v) = R^T v`` has ``|whiten(v)| = sqrt(v^T M v)``; gradients go the other way, so that
    ``whiten_gradients(J) @ whiten(v) = J v`` and ``Y Y^T = J M^-1 J^T`` for ``Y = whiten_gradients(J)``.
    Working with ``Y`` instead of ``G = Y Y^T`` avoids half of the loss of digits that forming ``G`` causes.

    Args:
        mass_matrix: symmetric positive definite, shape (nv, nv).

    Raises:
        InvalidCollisionError: not square, not finite, not symmetric or not positive definite.
    """

    _matrix: Any = staticmethod(finite_array)

    def __init__(self, mass_matrix: ArrayLike):
        M = self._matrix(mass_matrix, "mass_matrix")
        if M.ndim != 2 or M.shape[0] != M.shape[1] or M.shape[0] == 0:
            raise InvalidCollisionError(f"mass_matrix must be square and not empty, got shape {M.shape}")
        diagonal = M.diagonal()
        if diagonal.min() <= 0:
            i = int(np.argmin(diagonal))
            raise InvalidCollisionError(f"mass_matrix is not positive definite: entry ({i}, {i}) is {diagonal[i]}")
        is_diagonal = (np.count_nonzero(M) if isinstance(M, np.ndarray) else M.nnz) == M.shape[0]
        self.mass_matrix = M
        self._scale = np.sqrt(diagonal) if is_diagonal else None
        self._factor: Any = None if is_diagonal else self._factorize(M)

    def _factorize(self, M: Any) -> Any:
        """Return ``R^T``."""
        if np.count_nonzero(M != M.T):
            check_symmetry(M)
        factor, failed = scipy.linalg.lapack.dpotrf(M, lower=1)
        if failed:
            raise InvalidCollisionError(f"mass_matrix is not positive definite (leading minor {failed})")
        return np.asfortranarray(factor.T)

    def whiten(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``R^T v`` for one velocity (nv,) or several (n, nv)."""
        return velocity * self._scale if self._scale is not None else velocity @ self._factor.T

    def unwhiten(self, z: np.ndarray) -> np.ndarray:
        """Return ``R^-T z``, the inverse of `whiten`, for one vector (nv,) or several (n, nv)."""
        return z / self._scale if self._scale is not None else solve_rows(self._factor, z, transposed=0)

    def whiten_gradients(self, jacobian: np.ndarray) -> np.ndarray:
        """Return ``J R^-T``, shape (h, nv)."""
        return jacobian / self._scale if self._scale is not None else solve_rows(self._factor, jacobian, transposed=1)

    def norm(self, velocity: np.ndarray) -> float:
        """Return ``sqrt(v^T M v)``."""
        z = self.whiten(velocity)
        return sqrt(z.dot(z))


def check_symmetry(M: Any) -> None:
    """Raise `InvalidCollisionError` if a dense or sparse mass matrix is not symmetric up to rounding."""
    difference, scale = scipy.sparse.coo_array(M - M.T), np.sqrt(M.diagonal())
    i, j = difference.coords
    wrong = np.flatnonzero(np.abs(difference.data) > SYMMETRY * scale[i] * scale[j])
    if len(wrong):
        k = wrong[np.argmax(np.abs(difference.data[wrong]))]
        raise InvalidCollisionError(
            f"mass_matrix is not symmetric: ({i[k]}, {j[k]}) and its mirror differ by {difference.data[k]:.3g}"
        )


def solve_rows(factor: np.ndarray, rows: np.ndarray, *, transposed: int) -> np.ndarray:
    """Solve ``R^T x = row``, or transposed ``R x = row``, given R^T, for one row (nv,) or several (n, nv)."""
    if rows.ndim == 1:  # increment 1, offset 0, not the lower triangle: keywords would double the time of the call
        return scipy.linalg.blas.dtrsv(factor, rows, 1, 0, 0, transposed)
    if rows.size * len(factor) > _ROW_BY_ROW:
        return scipy.linalg.lapack.dtrtrs(factor, rows.T, trans=transposed)[0].T
    solved = np.empty_like(rows)
    for i, row in enumerate(rows):
        solved[i] = scipy.linalg.blas.dtrsv(factor, row, 1, 0, 0, transposed)
    return solved
