"""The closed form for one contact: ``Lambda = max(0, c / G)``."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.problem import Problem, Solution, Status


def closed_form(problem: Problem) -> Solution:
    """Solve a problem of one contact exactly; for any other problem the status is ``Status.STOPPED``."""
    if len(problem.bound) != 1:
        return Solution(np.zeros_like(problem.bound), Status.STOPPED)
    return Solution(np.maximum(problem.bound / problem.lengths / problem.lengths, 0.0))
