"""The kinetic metric of a sparse mass matrix: diagonal, or blocks that do not couple, such as those of free bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from impactlaw.errors import InvalidCollisionError
from impactlaw.mechanics.arrays import finite_sparse
from impactlaw.mechanics.kinetic_metric import KineticMetric, check_symmetry

LARGEST_BLOCK = 500
"""Most degrees of freedom in one block of coupled ones; the Cholesky factor of a block is a dense matrix."""


class SparseMetric(KineticMetric):
    """The kinetic metric of a mass matrix that is any scipy.sparse matrix or array, see `KineticMetric`.

    Degrees of freedom that M couples, directly or through others, form blocks, which are factored separately.

    Raises:
        InvalidCollisionError: as `KineticMetric`, or a block has more than `LARGEST_BLOCK` degrees of freedom.
    """

    _matrix = staticmethod(finite_sparse)
    _inverse: Any

    def _factorize(self, M: Any) -> Any:
        check_symmetry(M)
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


def _factors(M: Any) -> tuple[Any, Any]:
    """Return R and R^-1 as CSR arrays, from dense Cholesky factors of the blocks; blocks of equal size are batched."""
    _, member = scipy.sparse.csgraph.connected_components(M, directed=False)
    size = np.bincount(member)[member]  # of the block of each degree of freedom
    if size.max() > LARGEST_BLOCK:
        raise InvalidCollisionError(
            f"sparse mass_matrix couples {size.max()} degrees of freedom with each other, more than {LARGEST_BLOCK}; "
            "pass it as a dense array"
        )
    order = np.lexsort((member, size))  # block after block, the small ones first
    rows, columns, factors, inverses = [], [], [], []
    for n in np.unique(size):
        part = order[size[order] == n]
        blocks = scipy.sparse.bsr_array(M[part][:, part], blocksize=(n, n))
        try:
            R = np.linalg.cholesky(blocks.data)
        except np.linalg.LinAlgError:
            raise InvalidCollisionError("mass_matrix is not positive definite") from None
        entries = blocks.tocoo()  # in the order of the entries of R
        rows.append(part[entries.row])
        columns.append(part[entries.col])
        factors.append(R.ravel())
        inverses.append(np.tril(np.linalg.inv(R)).ravel())
    at = np.concatenate(rows), np.concatenate(columns)
    made = [scipy.sparse.csr_array((np.concatenate(values), at), shape=M.shape) for values in (factors, inverses)]
    for part in made:
        part.eliminate_zeros()
    return made[0], made[1]
