"""Solvers of the impact law's problem: one file for each, one registry, and one certificate for all."""

from impactlaw.solvers.certificate import Answer, beyond_rounding
from impactlaw.solvers.infeasibility import farkas_ray
from impactlaw.solvers.problem import Problem, Solution, Solver, Status
from impactlaw.solvers.solve import (
    SOLVERS,
    check_solver,
    load_solvers,
    nonnegative_combination,
    share,
    solve,
    solve_with_jump,
)
from impactlaw.solvers.tolerances import CERTIFIED

__all__ = [
    "CERTIFIED", "SOLVERS", "Answer", "Problem", "Solution", "Solver", "Status", "beyond_rounding", "check_solver",
    "farkas_ray", "load_solvers", "nonnegative_combination", "share", "solve", "solve_with_jump",
]  # fmt: skip
