"""The impulse of least norm among those that give the same velocity jump, computed on the identified face."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

_RANK = 1e-11  # relative singular value below which gradients of unit length count as dependent
_TIKHONOV = 1e-4  # weight that only picks the face; the answer on the face is exact


def least_norm(gradients: np.ndarray, impulse: np.ndarray, tight: np.ndarray) -> np.ndarray:
    """Return ``argmin |Lambda|`` over ``Lambda >= 0``, ``Y^T Lambda = Y^T impulse``, zero where not tight.

    Args:
        gradients: ``Y``, shape (h, nv).
        impulse: any solution ``Lambda >= 0``, shape (h,).
        tight: contacts that may carry an impulse, bool (h,), among them those that do in ``impulse``.

    Returns:
        The impulse of least norm, or ``impulse`` itself where it is the only one.
    """
    face = np.flatnonzero(tight & (np.einsum("ij,ij->i", gradients, gradients) > 0))
    if len(face) < 2:
        return impulse
    A = gradients[face].T
    lengths = np.linalg.norm(A, axis=0)
    singular = np.linalg.svd(A / lengths, compute_uv=False)
    if len(face) <= len(A) and singular[-1] > _RANK * singular[0]:
        return impulse
    jump = A @ impulse[face]
    best = _on_face(A, jump)
    if best.min() < 0:
        best = _with_signs(A, jump, best)
        if best is None:
            return impulse
    result = np.zeros_like(impulse)
    result[face] = best
    return result


def _on_face(A: np.ndarray, jump: np.ndarray) -> np.ndarray:
    """Least-norm solution of ``A x = jump`` with one step of refinement; signs within rounding of zero become zero."""
    inverse = np.linalg.pinv(A, rcond=_RANK)
    x = inverse @ jump
    x += inverse @ (jump - A @ x)
    x[np.abs(x) < 1e-14 * np.abs(x).max(initial=0.0)] = 0.0
    return x


def _with_signs(A: np.ndarray, jump: np.ndarray, start: np.ndarray) -> np.ndarray | None:
    """Least-norm ``x >= 0``: guess the support, then move it until the optimality conditions hold."""
    size = np.abs(A).max()
    weight = _TIKHONOV * size
    regular = np.vstack([A, weight * np.eye(A.shape[1])])
    guess, _ = nnls(regular, np.concatenate([jump, np.zeros(A.shape[1])]))
    support = guess > 1e-9 * max(guess.max(initial=0.0), np.abs(start).max())
    scale = np.linalg.norm(jump)
    for _ in range(2 * A.shape[1]):
        if not support.any():
            return None
        x = np.zeros(A.shape[1])
        x[support] = _on_face(A[:, support], jump)
        negative = support & (x < 0)
        if negative.any():
            support[np.argmin(x)] = False
            continue
        if np.linalg.norm(A @ x - jump) > 1e-12 * scale:
            return None
        # x_support = A_support^T mu; outside the support the gradient A^T mu must not be positive
        mu = np.linalg.lstsq(A[:, support].T, x[support], rcond=_RANK)[0]
        gradient = A.T @ mu
        gradient[support] = -np.inf
        worst = int(np.argmax(gradient))
        if gradient[worst] <= 1e-9 * x.max():
            return x
        support[worst] = True
    return None
