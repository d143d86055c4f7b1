"""Solvers of the impact law's problem: one file each, one registry, one certificate for all of them."""

from impactlaw.solvers.answer import ROUNDING, Answer
from impactlaw.solvers.base import Problem, Solution, Solver, Status
from impactlaw.solvers.farkas import farkas_ray
from impactlaw.solvers.solve import SOLVERS, nonnegative_combination, solve, solve_with_jump

__all__ = [
    "ROUNDING",
    "SOLVERS",
    "Answer",
    "Problem",
    "Solution",
    "Solver",
    "Status",
    "farkas_ray",
    "nonnegative_combination",
    "solve",
    "solve_with_jump",
]
