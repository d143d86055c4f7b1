"""The one problem every solver answers, the form of an answer, and the measure of how good it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Problem:
    """``min |z|^2 / 2  subject to  Y z >= c``: the smallest velocity jump that reaches the wanted contact velocities.

    Its optimality conditions are the impact law: ``z = Y^T Lambda`` and ``0 <= Lambda  ⊥  Y z - c >= 0``.

    Attributes:
        gradients: ``Y``, the gap gradients where the kinetic metric is Euclidean, shape (h, nv).
        bound: ``c = gamma^h - gamma-``, shape (h,).
        preimage: ``d`` with ``Y d = c`` where the law knows one, shape (nv,); then the jump is the projection of d
            onto the cone of the gradients, which always exists.
    """

    gradients: np.ndarray
    bound: np.ndarray
    preimage: np.ndarray | None = None

    @cached_property
    def norms(self) -> np.ndarray:
        """Lengths of the rows of Y, shape (h,)."""
        return np.sqrt(np.einsum("ij,ij->i", self.gradients, self.gradients))

    @cached_property
    def moving(self) -> np.ndarray:
        """Contacts that any velocity can change at all (rows of Y that are not zero), bool (h,)."""
        return self.norms > 0

    def slack(self, z: np.ndarray) -> np.ndarray:
        """``(Y z - c) / |Y_i|``, shape (h,), in sqrt(J); rows of zeros count as ``-c_i``."""
        return (self.gradients @ z - self.bound) / np.where(self.moving, self.norms, 1.0)

    def residual(self, impulse: np.ndarray) -> float:
        """Natural map ``max |min(Lambda_i |Y_i|, slack_i)|`` at ``z = Y^T Lambda``, sqrt(J)."""
        natural = np.minimum(impulse * self.norms, self.slack(impulse @ self.gradients))
        return float(np.abs(natural[self.moving]).max(initial=0.0))


class Status(StrEnum):
    """How a solver ended."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    STOPPED = "stopped"


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver hands back; only the certificate decides whether it is an answer.

    Attributes:
        impulse: ``Lambda``, shape (h,).
        status: how the solver ended.
        iterations: of the solver's own kind; 0 when it takes none.
    """

    impulse: np.ndarray
    status: Status = Status.SOLVED
    iterations: int = 0


class Solver(Protocol):
    """A solver is a function from a problem to a solution; it never raises for a problem that it cannot solve."""

    def __call__(self, problem: Problem) -> Solution:
        """Solve one problem."""
        ...
