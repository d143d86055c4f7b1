"""Confidence intervals of fitted numbers, for errors that are independent between collisions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from impactlaw.identification.restitution_matrix import MatrixFit

CONFIDENCE = 0.95
_STEP = 1e-4  # step of finite differences: small against errors, large against kinks of friction
_RANK = 1e-8  # singular value of derivatives, relative to the largest one, that counts as 0
_FITTED = 1e-8  # part of an error that remains after the fit, up to which the error cannot be observed
_NAN = (float("nan"), float("nan"))


def parameter_intervals(
    residual: Callable[[np.ndarray], np.ndarray], x: np.ndarray, sizes: Sequence[int], low: np.ndarray, high: np.ndarray
) -> tuple[list[tuple[float, float]], int]:
    """Return the intervals of the parameters x, and the number of parameters that the data determine; see `_widths`.

    Args:
        residual: function of x that returns the errors of all collisions, one after the other.
        x: the minimum.
        sizes: number of errors of each collision.
        low: lower bounds of x.
        high: upper bounds of x.
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
    """Return the intervals of the entries of E, and its rank: the least number of directions of ``gamma-`` per contact.

    The directions of a contact are those of the collisions in which it carries an impulse.

    Args:
        problem: the problem of the fit.
        F: its minimum, (h, h).
        active: which contacts carry impulses, bool (n, h).
    """
    h = len(F)
    weighted = problem.before @ problem.inverse_root / problem.speeds[:, None]
    pushed = [weighted[active[:, i]] for i in range(h)]
    rank = min(int(np.linalg.matrix_rank(rows, tol=1e-8 * np.sqrt(len(rows)))) if len(rows) else 0 for rows in pushed)
    nothing = dict.fromkeys(np.ndindex(h, h), _NAN)
    derivatives, constants = zip(*problem.equations(active), strict=True)
    w = np.linalg.eigvalsh(sum(D.T @ D for D in derivatives))
    if w[0] <= _RANK * max(w[-1], 1e-300) or problem.bound(F) >= 1.0 - 1e-9:
        return nothing, rank
    E, errors = problem.matrix(F), [D @ F.ravel() + e for D, e in zip(derivatives, constants, strict=True)]
    widths = _widths(derivatives, errors, np.kron(problem.root, problem.inverse_root.T)).reshape(h, h)
    return {at: (float(E[at] - widths[at]), float(E[at] + widths[at])) for at in nothing}, rank


def _widths(derivatives: Sequence[np.ndarray], errors: Sequence[np.ndarray], wanted: np.ndarray) -> np.ndarray:
    """Return the half widths of the confidence intervals of linear combinations of parameters at a minimum, (m,).

    Errors are independent between collisions and may differ in size. Their squares are corrected for the reduction by
    the fit. Student's t has separate degrees of freedom for each combination: few for a number that few collisions
    determine, however many others were measured (R. Bell and D. McCaffrey, Survey Methodology 28, 2002). A number that
    a single collision determines has no degrees of freedom left, and its width is nan.

    Args:
        derivatives: derivatives of the errors of each collision, (r, p) each.
        errors: errors of each collision, (r,) each.
        wanted: coefficients of the combinations, (m, p).
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
    """Return ``left^-1/2 felt``, (r, m), and the squared part of ``felt`` in the null space of ``left``, (m,).

    Args:
        felt: how much the errors of a collision change each combination, (r, m).
        left: the part of these errors that remains after the fit, ``1 - H``, (r, r).
    """
    s, V = np.linalg.eigh(left)
    seen, parts = s > _FITTED, V.T @ felt
    return (V[:, seen] / np.sqrt(s[seen])) @ parts[seen], (parts[~seen] ** 2).sum(axis=0)
