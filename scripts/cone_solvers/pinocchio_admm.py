"""Pinocchio's proximal ADMM with a spectral penalty, for contacts with three rows only.

(J. Carpentier, Q. Le Lidec, L. Montaut, *From compliant to rigid contact simulation*, Robotics: Science and Systems,
2024.) Pinocchio puts the tangential rows of a contact first. It gets coefficients of friction of 1, because the rows of
our problems are already scaled by them.
"""

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from impactlaw.solvers.cones import CONE

from .problem import Problem

_TOLERANCE = 1e-11
_ITERATIONS = 1000


def takes(problem: Problem) -> bool:
    """Return whether all groups are contacts with three rows."""
    return bool((problem.kind == CONE).all() and (problem.size == 3).all())


def admm(problem: Problem, guess: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the impulses and the number of iterations."""
    pin: Any = import_module("pinocchio")
    contacts = len(problem.size)
    order = np.arange(3 * contacts).reshape(contacts, 3)[:, [1, 2, 0]].reshape(-1)
    G = problem.delassus()[np.ix_(order, order)]
    settings, result = pin.ADMMSolverSettings(), pin.ADMMSolverResult()
    settings.admm_update_rule = pin.ADMMUpdateRule.SPECTRAL
    settings.absolute_complementarity_tol = settings.absolute_feasibility_tol = _TOLERANCE * problem.scale
    settings.relative_complementarity_tol = settings.relative_feasibility_tol = 0.0
    settings.max_iterations, settings.solve_ncp = _ITERATIONS, problem.exact
    if guess.any():
        result.setConstraintImpulseGuess(guess[order])
    solver = pin.ADMMConstraintSolver(3 * contacts)
    solver.solve(pin.DelassusOperatorDense(G), problem.offset[order], *_constraints(contacts), settings, result)
    x = np.empty(3 * contacts)
    x[order] = np.array(result.retrieveConstraintImpulses()).reshape(-1)
    return x, int(result.iterations)


@cache
def _constraints(contacts: int) -> tuple[Any, Any]:
    """Return models of `contacts` contact points with friction, and their data."""
    pin: Any = import_module("pinocchio")
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    models, data = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for _ in range(contacts):
        contact = pin.PointContactConstraintModel(model, 1)
        contact.setFriction(1.0)
        constraint = pin.ConstraintModel(contact)
        models.append(constraint)
        data.append(constraint.createData())
    return models, data
