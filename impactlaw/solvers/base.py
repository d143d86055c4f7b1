"""The one problem every solver answers, the form of an answer, and the measure of how good it is."""

from __future__ import annotations

from enum import StrEnum
from math import sqrt
from typing import NamedTuple, Protocol

import numpy as np


class Problem:
    """``min |z|^2 / 2  subject to  Y z >= c``: the smallest velocity jump that reaches the wanted contact velocities.

    Its optimality conditions are the impact law: ``z = Y^T Lambda`` and ``0 <= Lambda  ⊥  Y z - c >= 0``.

    Args:
        gradients: ``Y``, the gap gradients where the kinetic metric is Euclidean, shape (h, nv).
        bound: ``c = gamma^h - gamma-``, shape (h,).
        preimage: ``d`` with ``Y d = c`` where the law knows one, shape (nv,); then the jump is the projection of d
            onto the cone of the gradients, which always exists.
        speed: ``|v-|`` where it is known, sqrt(J): c was computed from it and carries its rounding.
        norms: lengths of the rows of Y, shape (h,), where they are known.

    Attributes:
        lengths: the norms, to divide by: 1 for rows of zeros, shape (h,).
        scale: largest of |v-|, |d| and ``|c_i| / |Y_i|``: a jump is called rounding in comparison with it, sqrt(J).
    """

    __slots__ = ("bound", "gradients", "lengths", "norms", "preimage", "scale", "speed")

    norms: np.ndarray
    lengths: np.ndarray
    scale: float

    def __init__(
        self,
        gradients: np.ndarray,
        bound: np.ndarray,
        preimage: np.ndarray | None = None,
        speed: float = 0.0,
        *,
        norms: np.ndarray | None = None,
    ):
        self.gradients, self.bound, self.preimage, self.speed = gradients, bound, preimage, speed
        self.norms = known = np.sqrt(np.vecdot(gradients, gradients)) if norms is None else norms
        self.lengths = known if np.count_nonzero(known) == len(known) else np.where(known > 0, known, 1.0)
        if preimage is not None:
            wanted = sqrt(preimage.dot(preimage))
        else:
            wanted = float(np.abs(bound / self.lengths).max(initial=0.0))
        self.scale = speed if speed > wanted else wanted

    def speed_at(self, jump: np.ndarray) -> float:
        """What errors are compared with: where |v-| is known, never more than the larger of |v-| and |v+|."""
        if self.speed > 0:
            return max(self.speed, 0.5 * sqrt(jump.dot(jump)))
        return max(self.scale, sqrt(jump.dot(jump)))

    def slack(self, z: np.ndarray) -> np.ndarray:
        """``(Y z - c) / |Y_i|``, shape (h,), in sqrt(J); rows of zeros count as ``-c_i``."""
        return (self.gradients.dot(z) - self.bound) / self.lengths


class Status(StrEnum):
    """How a solver ended."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    STOPPED = "stopped"


class Solution(NamedTuple):
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
