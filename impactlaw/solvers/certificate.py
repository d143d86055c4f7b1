"""Certify an impulse with its velocity jump, and polish it by solving again on the contacts that carry it."""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
import scipy

from impactlaw.solvers.least_squares import least_squares
from impactlaw.solvers.problem import Problem
from impactlaw.solvers.sparsity import as_dense
from impactlaw.solvers.tolerances import IMPULSE_ROUNDING, INDEPENDENT, JAMMED, POLISHED

LARGEST_POLISHED = 250_000
"""Largest number of entries of a CSR array that is polished by a dense solver, which would take seconds beyond."""


class Answer(NamedTuple):
    """An impulse with its velocity jump, and their distance from satisfying the law."""

    impulse: np.ndarray  # ``Lambda``, shape (h,)
    jump: np.ndarray  # ``z``, shape (nv,): ``Y^T Lambda``, up to rounding errors of impulses that nearly cancel
    slack: np.ndarray  # ``(Y z - c) / |Y_i|``, shape (h,), sqrt(J)
    # the larger of the length of the natural map ``min(Lambda_i |Y_i|, slack_i)`` and the part of ``|z - Y^T Lambda|``
    # that exceeds this rounding, sqrt(J)
    residual: float


def beyond_rounding(gap: float, impulses: float, speed: float) -> float:
    """Return the part of ``|z - Y^T Lambda|`` that the rounding of Lambda to doubles does not explain.

    Args:
        gap: ``|z - Y^T Lambda|``, sqrt(J).
        impulses: sum of ``Lambda_i |Y_i|``, sqrt(J): many times the speed if contacts jam and their impulses nearly
            cancel.
        speed: the larger of |v-| and |v+|; at most a hundredth of it is attributed to rounding.
    """
    return max(0.0, gap - min(IMPULSE_ROUNDING * impulses, JAMMED * speed))


def judge(problem: Problem, impulse: np.ndarray, jump: np.ndarray | None = None) -> Answer:
    """Return an impulse as an answer, with its residual; the jump may be given if it was computed separately."""
    made = problem.gradients.T.dot(impulse)
    z = made if jump is None else jump
    slack, scaled = problem.slack(z), impulse * problem.lengths
    residual = scipy.linalg.blas.dnrm2(np.minimum(scaled, slack))
    if jump is not None:
        left = jump - made
        residual = max(residual, beyond_rounding(sqrt(left @ left), scaled.sum(), 0.5 * problem.speed_at(jump)))
    return Answer(impulse, z, slack, residual if residual >= 0 else inf)  # infinite if it is NaN


def natural_residual(problem: Problem, impulse: np.ndarray) -> float:
    """Return the residual of an impulse, relative to the scale of the problem."""
    residual = judge(problem, impulse).residual
    return residual / problem.scale if problem.scale > 0 else residual


def judge_active(problem: Problem, active: np.ndarray | slice) -> Answer | None:
    """Return the answer with ``(Y z - c)_A = 0`` and zero impulse elsewhere, for contacts A, bool (h,) or a slice.

    Return None if an impulse is not positive or the gradients of A are not clearly independent. Y must be an array.
    """
    Y, c = problem.gradients[active], problem.bound[active]
    if not 0 < len(c) <= Y.shape[1]:
        return None
    factor, carried, failed = scipy.linalg.lapack.dposv(Y.dot(Y.T), c)
    # lists: with the few contacts of most collisions, their min() takes a quarter of the time of an array's
    if failed or min(carried.tolist()) <= 0:
        return None
    if min((factor.diagonal() / problem.lengths[active]).tolist()) < INDEPENDENT:
        return None
    impulse = np.zeros(len(problem.bound))
    impulse[active] = carried
    return judge(problem, impulse)


def polish(problem: Problem, impulse: np.ndarray) -> Answer:
    """Certify an impulse; if it is not accurate, solve again on the contacts that carry it, and keep the better."""
    answer = judge(problem, impulse)
    if problem.allows(answer.residual, POLISHED) or not impulse.any():
        return answer
    dense = as_dense(problem, LARGEST_POLISHED)
    if dense is None:
        return answer
    polished = judge_active(dense, impulse > 0)
    if polished is None or not problem.allows(polished.residual, POLISHED):
        polished = better(polished, _by_least_squares(dense, impulse > 0))
    return better(answer, polished)


def better(one: Answer | None, other: Answer) -> Answer:
    """Return the answer with the smaller residual, the first of two equal ones."""
    return other if one is None or other.residual < one.residual else one


def _by_least_squares(problem: Problem, active: np.ndarray) -> Answer:
    """Return the same answer as `judge_active`, but also for contacts with dependent gradients."""
    lengths = problem.lengths[active]
    Y = problem.gradients[active] / lengths[:, None]
    jump = least_squares(Y, problem.bound[active] / lengths)
    impulse = np.zeros_like(problem.bound)
    impulse[active] = np.maximum(least_squares(Y.T, jump), 0.0) / lengths
    return judge(problem, impulse, jump)
