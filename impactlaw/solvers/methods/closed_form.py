"""One contact: ``Lambda = max(0, c / G)``."""

from __future__ import annotations

from math import inf

import numpy as np

from impactlaw.solvers.certificate import Answer
from impactlaw.solvers.problem import Problem, Solution, Status


def closed_form(problem: Problem) -> Solution:
    """Solve a problem of one contact exactly; any other is answered by ``Status.STOPPED``."""
    if len(problem.bound) != 1:
        return Solution(np.zeros_like(problem.bound), Status.STOPPED)
    return Solution(np.maximum(problem.bound / problem.lengths / problem.lengths, 0.0))


def one_contact(problem: Problem) -> Answer:
    """Return the certified answer of one contact that closes, ``c > 0``: in Python's own numbers, which are faster."""
    y, c, length = problem.gradients[0], problem.bound.item(), problem.lengths.item()
    impulse = c / length / length
    jump = impulse * y
    slack = (float(y @ jump) - c) / length
    residual = abs(min(impulse * length, slack))
    return Answer(np.array([impulse]), jump, np.array([slack]), residual if residual >= 0 else inf)
