"""The impulse of least norm among those that give the same velocity jump, computed on the identified face."""

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

    With N an orthonormal basis of the impulses that move nothing and x the part of ``impulse`` orthogonal to them,
    Lambda is x where x >= 0, and ``x + N y`` with ``min |y|, N y >= -x`` otherwise: the form every solver answers.
    ``Y``, (h, nv), has no row of zeros. The impulse, (h,), is returned itself where it is the only solution; contacts
    that carry it are among those that are tight, bool (h,).
    """
    face = np.flatnonzero(tight)
    Y, x = gradients[face], impulse[face]
    lengths = np.sqrt(np.vecdot(Y, Y))
    U, singular, _ = scipy.linalg.svd(Y / lengths[:, None], check_finite=False, lapack_driver="gesvd")
    still = U[:, int(np.count_nonzero(singular > RANK * singular[0])) :]
    if still.shape[1] == 0:
        return impulse
    shared = np.linalg.norm(still, axis=1) > RANK  # the impulse of any other contact is the only one
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
    """Return `least_norm` of an array or, for every group of tight contacts that touch each other, of a CSR array.

    Groups are looked at where a tight contact carries nothing or there are more contacts than degrees of freedom.
    Those of more than `_LARGEST_GROUP` contacts keep the impulse they have: its norm is not the least.
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
