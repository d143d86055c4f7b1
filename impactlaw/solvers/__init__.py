"""Solvers of the impact law's problem: one file each, one registry, one certificate for all of them."""

from impactlaw.solvers.base import Problem, Solution, Solver, Status
from impactlaw.solvers.solve import SOLVERS, farkas_ray, nonnegative_combination, solve

__all__ = ["SOLVERS", "Problem", "Solution", "Solver", "Status", "farkas_ray", "nonnegative_combination", "solve"]
