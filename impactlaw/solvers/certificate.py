"""An impulse with its velocity jump, its certificate, and the second look at the contacts that carry it."""

from __future__ import annotations

import math
from math import inf
from typing import NamedTuple

import numpy as np

from impactlaw import deferred
from impactlaw.solvers.least_squares import least_squares
from impactlaw.solvers.problem import Problem
from impactlaw.solvers.sparsity import as_dense

_ROUNDING = 8 * float(np.finfo(float).eps)
_JAMMED = 1e-2  # part of the speed above which the rounding of impulses makes them meaningless
_POLISHABLE = 250_000  # entries of a CSR array up to which a second look, by a dense solver, does not take seconds
POLISHED = 1e-14
"""Relative residual that needs no second look."""


class Answer(NamedTuple):
    """An impulse with its velocity jump, and how far the two are from the law.

    Attributes:
        impulse: ``Lambda``, shape (h,).
        jump: ``z``, shape (nv,): ``Y^T Lambda`` but for the rounding of impulses that nearly cancel.
        slack: ``(Y z - c) / |Y_i|``, shape (h,), sqrt(J).
        residual: the larger of the length of the natural map ``min(Lambda_i |Y_i|, slack_i)`` and of
            ``|z - Y^T Lambda|`` beyond that rounding, sqrt(J).
    """

    impulse: np.ndarray
    jump: np.ndarray
    slack: np.ndarray
    residual: float


def beyond_rounding(gap: float, impulses: float, speed: float) -> float:
    """Return how much of ``|z - Y^T Lambda|`` is not the rounding of Lambda to doubles.

    Args:
        gap: ``|z - Y^T Lambda|``, sqrt(J).
        impulses: sum of ``Lambda_i |Y_i|``, sqrt(J): many times the speed where contacts jam and nearly cancel.
        speed: the larger of |v-| and |v+|; rounding beyond a hundredth of it is no excuse.
    """
    return max(0.0, gap - min(_ROUNDING * impulses, _JAMMED * speed))


def judge(problem: Problem, impulse: np.ndarray, jump: np.ndarray | None = None) -> Answer:
    """Measure how far an impulse, and a jump where one was computed apart from it, are from the law."""
    Y, lengths = problem.gradients, problem.lengths
    product = problem.transposed.dot(impulse) if problem.is_sparse else impulse.dot(Y)
    slack = Y.dot(product if jump is None else jump)
    slack -= problem.bound
    slack /= lengths
    scaled = impulse * lengths
    residual = deferred.dnrm2(np.minimum(scaled, slack))
    if jump is not None:
        gap = float(np.linalg.norm(jump - product))
        gap = beyond_rounding(gap, float(scaled.sum()), 0.5 * problem.speed_at(jump))
        product, residual = jump, max(residual, gap)
    return Answer(impulse, product, slack, residual if residual >= 0 else inf)  # infinite where it is not a number


def is_polishable(problem: Problem) -> bool:
    """Whether `polish` has a second look at answers that are not good enough."""
    return not problem.is_sparse or math.prod(problem.gradients.shape) <= _POLISHABLE


def polish(problem: Problem, impulse: np.ndarray) -> Answer:
    """Certify; where that is not good, solve once more on the contacts that carry an impulse, and keep the better."""
    answer = judge(problem, impulse)
    if answer.residual <= POLISHED * problem.speed:  # which is part of the scale, and known
        return answer
    if answer.residual <= POLISHED * problem.scale or not np.count_nonzero(impulse):
        return answer
    dense = as_dense(problem, _POLISHABLE)
    if dense is None:
        return answer
    problem = dense
    active = impulse > 0
    lengths = problem.lengths[active]
    Y, c = problem.gradients[active] / lengths[:, None], problem.bound[active] / lengths
    jump = least_squares(Y, c)
    better = np.zeros_like(impulse)
    better[active] = np.maximum(least_squares(Y.T, jump), 0.0) / lengths
    polished = judge(problem, better, jump)
    return polished if polished.residual < answer.residual else answer
