"""The kinetic metric of a sparse mass matrix: diagonal, or blocks that do not couple, such as those of free bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from impactlaw.errors import InvalidCollisionError
from impactlaw.mechanics.kinetic_metric import KineticMetric, real_array
from impactlaw.mechanics.tolerances import SYMMETRY

LARGEST_BLOCK = 500
"""Most degrees of freedom that may be coupled with each other; the factor of such a block is a dense matrix."""


class SparseMetric(KineticMetric):
    """A sparse mass matrix and its factor ``M = R R^T``.

    Degrees of freedom that M couples, directly or through others, form blocks. Each is factored by itself.

    Args:
        mass_matrix: symmetric positive definite, any scipy.sparse matrix or array, shape (nv, nv).

    Raises:
        InvalidCollisionError: not square, not finite, not symmetric, not positive definite, or more than
            `LARGEST_BLOCK` degrees of freedom in one block.
    """

    _inverse: Any

    def _take(self, mass_matrix: Any) -> Any:
        return finite_sparse(mass_matrix, "mass_matrix")

    def _factorize(self, M: Any) -> Any:
        _check_symmetry(M)
        R, self._inverse = _factors(M)
        return R.T

    def unwhiten(self, z: np.ndarray) -> np.ndarray:
        """Return ``R^-T z``, the inverse of `whiten`, for one vector (nv,) or several (n, nv)."""
        return z / self._scale if self._scale is not None else z @ self._inverse

    def whiten_gradients(self, jacobian: Any) -> Any:
        """Return ``J R^-T``, sparse, shape (h, nv)."""
        if self._scale is not None:
            data = jacobian.data / self._scale[jacobian.indices]
            return scipy.sparse.csr_array((data, jacobian.indices, jacobian.indptr), shape=jacobian.shape)
        return scipy.sparse.csr_array(jacobian @ self._inverse.T)


def is_sparse(values: Any) -> bool:
    """Whether these are a scipy.sparse matrix or array; imports nothing."""
    return hasattr(values, "tocsr")


def finite_sparse(values: Any, name: str) -> Any:
    """Return a copy as a read-only CSR array in double precision, without entries that are zero.

    What this function returned is taken as it is.

    Raises:
        InvalidCollisionError: not a matrix, not numbers, or not all of them finite.
    """
    if _is_finished(values):
        return values
    try:
        array = scipy.sparse.csr_array(values, copy=True)
        array.data = real_array(array.data)
    except (TypeError, ValueError) as error:
        raise InvalidCollisionError(f"{name} is not a matrix of numbers: {error}") from None
    if array.ndim != 2:
        raise InvalidCollisionError(f"{name} must be a matrix, got shape {array.shape}")
    array.sum_duplicates()
    if not np.isfinite(array.data).all():
        raise InvalidCollisionError(f"{name} has entries that are not finite")
    array.eliminate_zeros()
    array.data, array.indices, array.indptr = map(_own, (array.data, array.indices, array.indptr))
    return array


def _own(part: np.ndarray) -> np.ndarray:
    """Return the array, or a copy if others hold views of it, as one that cannot be written to."""
    part = part if part.base is None else part.copy()
    part.flags.writeable = False
    return part


def _is_finished(values: Any) -> bool:
    if type(values) is not scipy.sparse.csr_array or values.ndim != 2 or not values.has_canonical_format:
        return False
    data, parts = values.data, (values.data, values.indices, values.indptr)
    if data.dtype != float or any(part.flags.writeable or part.base is not None for part in parts):
        return False
    return bool(np.isfinite(data).all() and data.all())


def _check_symmetry(M: Any) -> None:
    difference = (M - M.T).tocoo()
    scale = np.sqrt(M.diagonal())
    wrong = np.abs(difference.data) > SYMMETRY * scale[difference.row] * scale[difference.col]
    if wrong.any():
        k = int(np.argmax(np.where(wrong, np.abs(difference.data), 0.0)))
        raise InvalidCollisionError(
            f"mass_matrix is not symmetric: ({difference.row[k]}, {difference.col[k]}) and its mirror differ by "
            f"{difference.data[k]:.3g}"
        )


def _factors(M: Any) -> tuple[Any, Any]:
    """Return R and R^-1 as CSR arrays, by a dense Cholesky factor of every block, those of one size together."""
    count, member = scipy.sparse.csgraph.connected_components(M, directed=False)
    sizes = np.bincount(member, minlength=count)
    if sizes.max() > LARGEST_BLOCK:
        raise InvalidCollisionError(
            f"sparse mass_matrix couples {sizes.max()} degrees of freedom with each other, more than {LARGEST_BLOCK}; "
            "pass it as a dense array"
        )
    order = np.argsort(member, kind="stable")
    starts = np.cumsum(sizes) - sizes
    place = np.empty(len(member), dtype=int)  # of each degree of freedom within its block
    place[order] = np.arange(len(member)) - np.repeat(starts, sizes)
    entries = M.tocoo()
    size_of_entry = sizes[member[entries.row]]
    rows, columns, factors, inverses = [], [], [], []
    for size in np.unique(sizes):
        blocks = np.flatnonzero(sizes == size)
        number = np.empty(count, dtype=int)
        number[blocks] = np.arange(len(blocks))
        here = size_of_entry == size
        dense = np.zeros((len(blocks), size, size))
        row, column = entries.row[here], entries.col[here]
        dense[number[member[row]], place[row], place[column]] = entries.data[here]
        try:
            R = np.linalg.cholesky(dense)
        except np.linalg.LinAlgError:
            raise InvalidCollisionError("mass_matrix is not positive definite") from None
        dofs = order[starts[blocks, None] + np.arange(size)]
        rows.append(np.broadcast_to(dofs[:, :, None], R.shape).ravel())
        columns.append(np.broadcast_to(dofs[:, None, :], R.shape).ravel())
        factors.append(R.ravel())
        inverses.append(np.tril(np.linalg.inv(R)).ravel())
    at = (np.concatenate(rows), np.concatenate(columns))
    made = [scipy.sparse.csr_array((np.concatenate(values), at), shape=M.shape) for values in (factors, inverses)]
    for part in made:
        part.eliminate_zeros()
    return made[0], made[1]
