"""Confidence intervals of fitted numbers: what independent errors of the collisions leave open."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from impactlaw.identification.restitution_matrix import MatrixFit

CONFIDENCE = 0.95
_STEP = 1e-4  # of differences that make derivatives; small against errors, large against kinks of friction
_RANK = 1e-8  # singular value of derivatives, relative to the largest one, that says nothing
_FITTED = 1e-8  # part of an error of one collision that the fit leaves, up to which that error cannot be seen
_NAN = (float("nan"), float("nan"))


def parameter_intervals(
    residual: Callable[[np.ndarray], np.ndarray], x: np.ndarray, sizes: Sequence[int], low: np.ndarray, high: np.ndarray
) -> tuple[list[tuple[float, float]], int]:
    """Return the intervals of the parameters x, and how many of these the data tell; see `_widths`.

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
        widths = _widths(np.split(J[:, free], cuts), np.split(r, cuts), np.eye(int(np.count_nonzero(free))))
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
    pushed = [weighted[active[:, i]] for i in range(h)]
    rank = min(int(np.linalg.matrix_rank(rows, tol=1e-8 * np.sqrt(len(rows)))) if len(rows) else 0 for rows in pushed)
    nothing = dict.fromkeys(np.ndindex(h, h), _NAN)
    w = np.linalg.eigvalsh(problem.quadratic(active).H)
    if w[0] <= _RANK * max(w[-1], 1e-300) or problem.bound(F) >= 1.0 - 1e-9:
        return nothing, rank
    E, derivatives, errors = problem.matrix(F), [], []
    for i in range(len(active)):
        A = np.flatnonzero(active[i])
        L = np.linalg.cholesky(problem.G[i][np.ix_(A, A)])
        rows = np.linalg.solve(L, problem.root[A]) / problem.speeds[i]
        derivatives.append(np.kron(rows, problem.before[i] @ problem.inverse_root))
        left = (problem.after[i] + E @ problem.before[i])[A] / problem.speeds[i]
        errors.append(np.linalg.solve(L, left))
    widths = _widths(derivatives, errors, np.kron(problem.root, problem.inverse_root.T)).reshape(h, h)
    return {at: (float(E[at] - widths[at]), float(E[at] + widths[at])) for at in nothing}, rank


def _widths(derivatives: Sequence[np.ndarray], errors: Sequence[np.ndarray], wanted: np.ndarray) -> np.ndarray:
    """Return half of the widths of the intervals of combinations of parameters at a minimum, (m,).

    Errors are independent from collision to collision and may differ in size. Their squares are enlarged by what the
    fit takes off them, and Student's t has the degrees of freedom that are left for each combination by itself: a
    number that few collisions tell has few, whatever else was measured (R. Bell and D. McCaffrey, Survey Methodology
    28, 2002). One that a single collision tells has none: its width is nan.

    Args:
        derivatives: of the errors of each collision, (r, p) each.
        errors: of each collision, (r,) each.
        wanted: combinations, (m, p).
    """
    from scipy.stats import t

    bread = np.linalg.inv(sum(J.T @ J for J in derivatives))
    square, trace, products, hidden = np.zeros((4, len(wanted)))
    outer = np.zeros((len(wanted), *bread.shape))
    for J, r in zip(derivatives, errors, strict=True):
        if not len(r):
            continue
        a, unseen = _enlarged(J @ bread @ wanted.T, np.eye(len(r)) - J @ bread @ J.T)
        q = a.T @ J
        lengths, taken = (a**2).sum(axis=0), np.einsum("mp,pq,mq->m", q, bread, q)
        square, trace, hidden = square + (r @ a) ** 2, trace + lengths - taken, hidden + unseen
        products += lengths**2 - 2.0 * lengths * taken
        outer += np.einsum("mp,mq->mpq", q, q)
    products += np.einsum("mpq,qr,mrs,sp->m", outer, bread, outer, bread, optimize=True)
    told = hidden <= _FITTED * np.einsum("mp,pq,mq->m", wanted, bread, wanted)
    told &= (trace > 0.0) & (products > 0.0)
    widths = np.full(len(wanted), np.nan)
    widths[told] = np.sqrt(square[told]) * t.ppf(0.5 + 0.5 * CONFIDENCE, trace[told] ** 2 / products[told])
    return widths


def _enlarged(felt: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``left^-1/2 felt``, (r, m), and the squares of the part of felt where nothing is left, (m,).

    Args:
        felt: how much the errors of a collision move each combination, (r, m).
        left: what the fit leaves of these errors, ``1 - H``, (r, r).
    """
    s, V = np.linalg.eigh(left)
    seen, parts = s > _FITTED, V.T @ felt
    return (V[:, seen] / np.sqrt(s[seen])) @ parts[seen], (parts[~seen] ** 2).sum(axis=0)
