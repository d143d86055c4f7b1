"""Confidence intervals of fitted numbers: what independent errors of the collisions leave open."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from impactlaw.identification.restitution_matrix import MatrixFit

CONFIDENCE = 0.95
_STEP = 1e-4  # of differences that make derivatives; small against errors, large against kinks of friction
_RANK = 1e-8  # singular value of derivatives, relative to the largest one, that says nothing
_NAN = (float("nan"), float("nan"))


def parameter_intervals(
    residual: Callable[[np.ndarray], np.ndarray],
    x: np.ndarray,
    sizes: Sequence[int],
    low: np.ndarray,
    high: np.ndarray,
) -> tuple[list[tuple[float, float]], int]:
    """Return the intervals of the parameters x, and how many of these the data tell.

    The covariance is that of sandwich form, ``(J^T J)^-1 (sum J_i^T r_i r_i^T J_i) (J^T J)^-1`` over collisions i,
    times ``n / (n - p)``: collisions may have errors of different size (H. White, Econometrica 48, 1980).

    Args:
        residual: errors of all collisions, one after the other.
        x: the minimum.
        sizes: errors per collision.
        low: bounds of x.
        high: bounds of x.
    """
    r, columns = residual(x), []
    for i in range(len(x)):
        up, down = x.copy(), x.copy()
        up[i], down[i] = min(x[i] + _STEP, high[i]), max(x[i] - _STEP, low[i])
        columns.append((residual(up) - residual(down)) / (up[i] - down[i]))
    J = np.array(columns).T
    s = np.linalg.svd(J, compute_uv=False)
    rank = int(np.count_nonzero(s > _RANK * max(s.max(initial=0.0), 1e-12)))
    free = (x > low + _STEP) & (x < high - _STEP) & (np.linalg.norm(J, axis=0) > 1e-9)
    intervals = [_NAN] * len(x)
    if free.any() and np.linalg.matrix_rank(J[:, free], tol=_RANK * s[0]) == np.count_nonzero(free):
        cuts = np.cumsum(sizes)[:-1]
        scores = np.array([a.T @ b for a, b in zip(np.split(J[:, free], cuts), np.split(r, cuts), strict=True)])
        H = J[:, free].T @ J[:, free]
        widths = _widths(H, scores, len(sizes))
        for i, width in zip(np.flatnonzero(free), widths, strict=True):
            intervals[i] = (float(x[i] - width), float(x[i] + width))
    return intervals, rank


def matrix_intervals(
    problem: MatrixFit, F: np.ndarray, active: np.ndarray
) -> tuple[dict[tuple[int, int], tuple[float, float]], int]:
    """Return the intervals of the entries of E, and its rank: directions of ``gamma-`` that each contact has met.

    Args:
        problem: of the fit.
        F: the minimum, (h, h).
        active: which contacts carry impulses, bool (n, h).
    """
    h = len(F)
    weighted = problem.before @ problem.inverse_root / problem.speeds[:, None]
    ranks = [_numerical_rank(weighted[active[:, i]]) for i in range(h)]
    q = problem.quadratic(active)
    nothing = {(i, j): _NAN for i in range(h) for j in range(h)}
    w = np.linalg.eigvalsh(q.H)
    if w[0] <= _RANK * max(w[-1], 1e-300) or problem.bound(F) >= 1.0 - 1e-9:
        return nothing, min(ranks)
    scores = []
    for i in range(len(active)):
        A = np.flatnonzero(active[i])
        if not len(A):
            continue
        W = np.zeros((h, h))
        W[np.ix_(A, A)] = np.linalg.inv(problem.G[i][np.ix_(A, A)])
        W = problem.root @ W @ problem.root / problem.speeds[i] ** 2
        a, b = problem.inverse_root @ problem.before[i], problem.inverse_root @ problem.after[i]
        scores.append(np.outer(W @ (b + F @ a), a).ravel())
    if len(scores) <= h:
        return nothing, min(ranks)
    to_E = np.kron(problem.root, problem.inverse_root.T)
    inverse = np.linalg.inv(to_E)
    H, S = inverse.T @ q.H @ inverse, np.array(scores) @ inverse
    E, widths = problem.matrix(F), _widths(H, S, len(scores), parameters=h).reshape(h, h)
    return {(i, j): (float(E[i, j] - widths[i, j]), float(E[i, j] + widths[i, j])) for i, j in nothing}, min(ranks)


def _widths(H: np.ndarray, scores: np.ndarray, n: int, parameters: int | None = None) -> np.ndarray:
    """Return half of the widths of the intervals, (p,), from the Hessian and the gradient of each collision, (n, p)."""
    from scipy.stats import t

    p = len(H) if parameters is None else parameters
    if n <= p:
        return np.full(len(H), np.nan)
    bread = np.linalg.inv(H)
    covariance = bread @ (scores.T @ scores) @ bread * n / (n - p)
    return np.sqrt(covariance.diagonal()) * t.ppf(0.5 + 0.5 * CONFIDENCE, n - p)


def _numerical_rank(a: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(a, tol=1e-8 * np.sqrt(max(len(a), 1)))) if len(a) else 0
