"""Clarabel, an interior point method for convex cone programs; exact friction is a fixed point of such programs.

The convex relaxation is ``min |z|^2 / 2 + |w|^2 / 2 + bound^T |u|`` over whitened velocity jumps z and
``w = sqrt(c) x``, with ``u = Y z + sqrt(c) w + b`` in the cones, and 0 in bilateral rows. The multipliers are the
impulses. De Saxcé's correction ``s = |u_t|`` is added to b: each program holds it constant, its solution updates it.
"""

from importlib import import_module
from typing import Any

import numpy as np
from scipy import sparse

from impactlaw.solvers.cones import BILATERAL, BOX

from .problem import Problem

_TOLERANCE = 1e-12
_ROUNDS = 50  # largest number of rounds of the fixed-point iteration
_IDLE, _LESS = 5, 0.9  # it stops after so many rounds in which the natural map stays above this part of its minimum
_ENOUGH = 1e-10


class Program:
    """The cone program of a problem, with velocities and impulses divided by the problem's scale."""

    def __init__(self, problem: Problem):
        clarabel = import_module("clarabel")
        self._problem = problem
        boxes = problem.kind == BOX
        self._box = np.repeat(boxes, problem.size)
        self._many = int(boxes.sum())
        soft = np.flatnonzero(problem.compliance)
        root = sparse.csr_array(
            (np.sqrt(problem.compliance[soft]), (soft, np.arange(len(soft)))), (len(problem.offset), len(soft))
        )
        rows: Any = sparse.hstack([problem.rows, root], format="csr")
        free, size = rows.shape[1], rows.shape[1] + self._many
        above = sparse.diags_array(np.ones(self._many), shape=(self._many, self._many))
        A = sparse.block_array(
            [[-rows[~self._box], None], [rows[self._box], -above], [-rows[self._box], -above]], format="csc"
        )
        P = sparse.diags_array(np.repeat([1.0, 0.0], [free, self._many]), shape=(size, size)).tocsc()
        q = np.concatenate([np.zeros(free), problem.bound[boxes] / problem.scale])
        cones = [_cone(clarabel, kind, m) for kind, m in zip(problem.kind[~boxes], problem.size[~boxes], strict=True)]
        cones += [clarabel.NonnegativeConeT(2 * self._many)] * (self._many > 0)
        self._solver = clarabel.DefaultSolver(P, q, A, self._offset(np.zeros(len(boxes))), cones, _settings(clarabel))

    def _offset(self, shift: np.ndarray) -> np.ndarray:
        b = self._problem.offset / self._problem.scale
        b[self._problem.first] += shift / self._problem.scale
        return np.concatenate([b[~self._box], -b[self._box], b[self._box]])

    def solve(self, shift: np.ndarray) -> tuple[np.ndarray, int]:
        """Solve the program with this correction, and return the impulses and the number of iterations."""
        self._solver.update(b=self._offset(shift))
        result = self._solver.solve()
        y = np.array(result.z) * self._problem.scale
        x, rest = np.empty(len(self._box)), y[len(y) - 2 * self._many :]
        x[~self._box] = y[: len(y) - 2 * self._many]
        x[self._box] = rest[self._many :] - rest[: self._many]
        return x, result.iterations


def _cone(clarabel: Any, kind: int, size: int) -> Any:
    if kind == BILATERAL:
        return clarabel.ZeroConeT(1)
    return clarabel.SecondOrderConeT(int(size)) if size > 1 else clarabel.NonnegativeConeT(1)


def _settings(clarabel: Any) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
    return settings


def fixed_point(problem: Problem, guess: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the best impulses over all rounds, and the total number of iterations; convex friction takes one round."""
    program = Program(problem)
    if not problem.exact:
        return program.solve(np.zeros(len(problem.size)))
    shift = problem.slips(guess) if guess.any() else np.zeros(len(problem.size))
    best, least, idle, taken = guess, np.inf, 0, 0
    for _ in range(_ROUNDS):
        x, iterations = program.solve(shift)
        taken += iterations
        missed = problem.natural_map(x)
        idle = 0 if missed < _LESS * least else idle + 1
        if missed < least:
            best, least = x, missed
        if least <= _ENOUGH or idle >= _IDLE or not np.isfinite(missed):
            break
        shift = problem.slips(x)
    return best, taken
