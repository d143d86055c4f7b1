"""The stability study's own certificate of a collision, in extended precision.

It is computed from mass matrix, gap gradients, the velocities before and after, and the impulses. Errors are relative
to the larger of |v-| and |v+| in the kinetic metric:

    momentum         |R^-1 (M (v+ - v-) - J^T Lambda - J_t^T Lambda_t)|,  M = R R^T
    complementarity  max |min(Lambda_i |g_i|, (gamma+_i - gamma^h_i) / |g_i|)|,  gamma^h = -E gamma-
    friction         max |x - P(x - u / l^2)| l,  x = Lambda_t / mu,  u = mu gamma_t+,  P onto the ball |x| <= Lambda_n,
                     l the length of the longest of the contact's rows ``mu J_t``

Bilateral constraints: ``v = v_fixed + N u``, where the columns of N are a basis of the null space of J_eq and v_fixed
is orthogonal to it in the kinetic metric. The jump must stay in the null space. All errors above are then evaluated for
u, with ``N^T M N``, ``J N`` and ``J_t N``, where no bilateral impulse remains; ``J v_fixed`` counts as the motion of a
surface. Rounding v+ and Lambda to doubles alone causes a momentum error of some eps times ``sum Lambda_i |g_i|`` and,
if M is not diagonal, of cond(M) eps times the jump; this much is subtracted from the momentum error.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

_RANK = 1e-9  # relative singular value below which constraints are redundant, with rows of J_eq scaled to unit length


@dataclass(frozen=True)
class Certificate:
    """The study's own check of one collision.

    Attributes:
        residual: the largest of the errors above and of the jump that violates bilateral constraints, relative to the
            speed.
        balance: ``|T+ - T- - Lambda^T (gamma- + gamma+) / 2|``, with the bodies' own velocities and with the work of
            friction, relative to the larger energy.
        change: work of the contact impulses, ``Lambda^T (gamma- + gamma+) / 2`` plus that of friction, relative to the
            larger energy; it is ``T+ - T-`` where no surface and no constraint moves.
        penetration: largest ``-gamma+_i / |g_i|``, relative to the speed.
    """

    residual: float
    balance: float
    change: float
    penetration: float


class Sliding(NamedTuple):
    """Friction of a collision; rows as in `impactlaw.Friction`.

    Attributes:
        jacobian: ``J_t``, (k, nv).
        contact: the contact of each row, (k,).
        coefficient: ``mu``, (k,).
        impulse: ``Lambda_t``, (k,).
        before: ``w_t-``, (k,).
        after: ``w_t+``, (k,).
    """

    jacobian: np.ndarray
    contact: np.ndarray
    coefficient: np.ndarray
    impulse: np.ndarray
    before: np.ndarray
    after: np.ndarray


def certify(
    M,
    J,
    before,
    after,
    impulse,
    wanted,
    *,
    bilateral=None,
    surfaces: tuple[np.ndarray, np.ndarray] | None = None,
    sliding: Sliding | None = None,
    rounding: float = 0.0,
    kind: type = np.longdouble,
) -> Certificate:
    """Check one collision.

    Args:
        M: mass matrix, (nv, nv).
        J: gap gradients, (h, nv).
        before: ``v-``, (nv,).
        after: ``v+``, (nv,).
        impulse: ``Lambda``, (h,).
        wanted: ``gamma^h``, (h,).
        bilateral: ``J_eq``, (m, nv).
        surfaces: ``w-`` and ``w+``, (h,) each.
        sliding: friction.
        rounding: closing velocity that counts as zero, because it may be rounding, m/s.
        kind: type of floating-point numbers to compute with.
    """
    M, J, before, after, impulse, wanted = (np.asarray(a, kind) for a in (M, J, before, after, impulse, wanted))
    w = np.zeros((2, len(J)), kind) if surfaces is None else np.asarray(surfaces, kind)
    if sliding is None:
        none = np.zeros(0)
        sliding = Sliding(np.zeros((0, len(M))), none.astype(int), none, none, none, none)
    mu, rest = np.asarray(sliding.coefficient, kind), np.asarray(sliding.impulse, kind)
    T, wt = np.asarray(sliding.jacobian, kind), np.asarray([sliding.before, sliding.after], kind)
    size = max(_norm(M, before), _norm(M, after)) or 1.0
    off = 0.0
    if bilateral is not None:
        N = _null_space(np.asarray(bilateral, float)).astype(kind)
        jump = after - before
        off = _norm(M, jump - N @ (N.T @ jump))
        reduced = N.T @ M @ N
        R = _cholesky(reduced)
        u = _backward(R, _forward(R, (N.T @ (M @ before))[:, None]))[:, 0]
        fixed = before - N @ u
        w, wt = w + J @ fixed, wt + T @ fixed
        M, J, T, before, after = reduced, J @ N, T @ N, u, u + N.T @ jump
    R = _cholesky(M)
    Y, Yt = _forward(R, J.T).T, _forward(R, T.T).T
    lengths, sides = np.sqrt((Y * Y).sum(axis=1)), np.sqrt((Yt * Yt).sum(axis=1))
    old, new = R.T @ before, R.T @ after
    jump = new - old
    inexact = _rounding(M, jump) + 64 * _EPS * float(impulse @ lengths + np.abs(rest) @ sides)
    left = jump - Y.T @ impulse - Yt.T @ rest
    errors = [off, max(0.0, float(np.sqrt(left @ left)) - inexact)]
    gamma, slide = J @ after + w[1], T @ after + wt[1]
    moves = lengths > 0
    natural = np.minimum((impulse * lengths)[moves], (gamma - wanted)[moves] / lengths[moves])
    errors.append(float(np.abs(natural).max(initial=0.0)))
    errors += [
        _friction_error(rest[on] / mu[on], (mu * slide)[on], float((mu * sides)[on].max()), impulse[i])
        for i in range(len(J))
        if (on := sliding.contact == i).any()
    ]
    energy = float(max(old @ old, new @ new)) / 2 or 1.0
    own = float(impulse @ (J @ (before + after)) + rest @ (T @ (before + after))) / 2
    work = own + float(impulse @ (w[0] + w[1]) + rest @ (wt[0] + wt[1])) / 2
    balance = abs(float(jump @ (old + jump / 2)) - own)
    return Certificate(
        max(errors) / size,
        max(0.0, balance - inexact * size) / energy,
        work / energy,
        float(((-rounding - gamma[moves]) / lengths[moves]).max(initial=0.0)) / size,
    )


_EPS = float(np.finfo(float).eps)


def _norm(M: np.ndarray, v: np.ndarray) -> float:
    return float(np.sqrt(max(v @ (M @ v), 0)))


def _rounding(M: np.ndarray, jump: np.ndarray) -> float:
    """Return the momentum error that rounding of v+ causes if M is not diagonal."""
    if np.count_nonzero(M) == len(M):
        return 0.0
    return _EPS * float(np.linalg.cond(M.astype(float))) * float(np.sqrt(jump @ jump))


def _friction_error(x: np.ndarray, u: np.ndarray, length: float, pressing: float) -> float:
    """Return the friction error of a contact, see the module."""
    if length == 0.0:
        return 0.0
    aim = x - u / length**2
    size = float(np.sqrt(aim @ aim))
    if size > pressing:
        aim = aim * (max(pressing, 0.0) / size)
    return float(np.sqrt((x - aim) @ (x - aim))) * length


def _null_space(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the null space of the rows, (nv, r)."""
    lengths = np.linalg.norm(rows, axis=1)
    _, s, V = np.linalg.svd(rows[lengths > 0] / lengths[lengths > 0, None])
    return V[np.count_nonzero(s > _RANK * s.max(initial=0.0)) :].T


def _cholesky(M: np.ndarray) -> np.ndarray:
    if np.count_nonzero(M) == len(M):
        return np.diag(np.sqrt(np.diag(M)))
    R = np.zeros_like(M)
    for j in range(len(M)):
        R[j:, j] = M[j:, j] - R[j:, :j] @ R[j, :j]
        R[j:, j] /= np.sqrt(R[j, j])
    return R


def _forward(R: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return ``R^-1 B``."""
    if np.count_nonzero(R) == len(R):
        return B / np.diag(R)[:, None]
    X = np.zeros_like(B)
    for i, row in enumerate(R):
        X[i] = (B[i] - row[:i] @ X[:i]) / row[i]
    return X


def _backward(R: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return ``R^-T B``."""
    return _forward(R.T[::-1, ::-1], B[::-1])[::-1]
