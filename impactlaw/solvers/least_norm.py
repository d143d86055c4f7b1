"""Find the impulse of least norm among those with the same velocity jump, on the contacts that are tight."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from impactlaw.solvers.least_squares import least_squares
from impactlaw.solvers.methods.dual_active_set import dual_active_set
from impactlaw.solvers.problem import Problem, Status
from impactlaw.solvers.tolerances import NO_IMPULSE, RANK

_LARGEST_GROUP = 100  # contacts; for more it would take seconds


def least_norm(gradients: np.ndarray, impulse: np.ndarray, tight: np.ndarray) -> np.ndarray:
    """Return ``argmin |Lambda|`` over ``Lambda >= 0``, ``Y^T Lambda = Y^T impulse``, zero where not tight.

    Let N be an orthonormal basis of the impulses without a velocity jump, and x the part of ``impulse`` orthogonal to
    them. If ``x >= 0``, Lambda is x. Otherwise it is ``x + N y`` with ``min |y|, N y >= -x``, a problem of the form
    that every solver solves. If ``impulse`` is the only solution, it is returned itself.

    Args:
        gradients: ``Y``, (h, nv), without rows of zeros.
        impulse: an impulse, (h,).
        tight: whether contacts are tight, bool (h,); includes all contacts that carry an impulse.
    """
    face = np.flatnonzero(tight)
    Y, x = gradients[face], impulse[face]
    lengths = np.sqrt(np.vecdot(Y, Y))
    U, singular, _ = scipy.linalg.svd(Y / lengths[:, None], check_finite=False, lapack_driver="gesvd")
    still = U[:, int(np.count_nonzero(singular > RANK * singular[0])) :]
    if still.shape[1] == 0:
        return impulse
    shared = np.linalg.norm(still, axis=1) > RANK  # the impulse of every other contact is unique
    N = scipy.linalg.qr(still / lengths[:, None], mode="economic", check_finite=False)[0][shared]
    part = least_squares(Y[shared].T, x[shared] @ Y[shared], RANK)
    part[np.abs(part) < NO_IMPULSE * np.abs(part).max()] = 0.0
    if part.min() < 0:
        solution = dual_active_set(Problem(N, -part))
        if solution.status is not Status.SOLVED:
            return impulse
        carrying = solution.impulse == 0
    else:
        carrying = part > 0
    on = impulse > 0
    on[face[shared]] = carrying
    result = np.zeros_like(impulse)
    result[on] = np.maximum(least_squares(gradients[on].T, x @ Y, RANK), 0.0)
    return result


def share_impulse(gradients: Any, impulse: np.ndarray, tight: np.ndarray) -> np.ndarray:
    """Return the impulse of least norm, see `least_norm`; for a CSR array, group by group of coupled tight contacts.

    Only groups are treated in which a tight contact has zero impulse, or which have more contacts than degrees of
    freedom. Groups of more than `_LARGEST_GROUP` contacts keep their impulse, whose norm may not be the least.
    """
    if isinstance(gradients, np.ndarray):
        return least_norm(gradients, impulse, tight)
    face = np.flatnonzero(tight)
    Y = gradients[face]
    h, nv = Y.shape
    ends = np.concatenate([Y.indptr, np.full(nv, Y.indptr[-1])])
    touched = scipy.sparse.csr_array((np.ones(len(Y.indices)), Y.indices + h, ends), shape=(h + nv, h + nv))
    count, group = scipy.sparse.csgraph.connected_components(touched, directed=False)
    group, freedom = group[:h], np.bincount(group[h:], minlength=count)
    sizes = np.bincount(group, minlength=count)
    idle = np.bincount(group, weights=impulse[face] <= 0, minlength=count) > 0
    result = impulse
    for which in np.flatnonzero((idle | (sizes > freedom)) & (sizes <= _LARGEST_GROUP)):
        rows = face[group == which]
        part = gradients[rows]
        dense = part[:, np.unique(part.indices)].toarray()
        shared = least_norm(dense, impulse[rows], np.ones(len(rows), dtype=bool))
        if (shared != impulse[rows]).any():
            result = impulse.copy() if result is impulse else result
            result[rows] = shared
    return result
