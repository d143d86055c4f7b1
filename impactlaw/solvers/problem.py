"""The problem that every solver solves, the form of a solution, and the scale of its errors."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from functools import cached_property
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
import scipy


class Problem:
    """``min |z|^2 / 2  subject to  Y z >= c``: the smallest velocity jump that reaches the wanted contact velocities.

    Its optimality conditions are the impact law: ``z = Y^T Lambda`` and ``0 <= Lambda  ⊥  Y z - c >= 0``.

    Args:
        gradients: ``Y``, the gap gradients in coordinates in which the kinetic metric is Euclidean, shape (h, nv); may
            be a CSR array.
        bound: ``c = gamma^h - gamma-``, shape (h,).
        preimage: ``d`` with ``Y d = c``, shape (nv,), if the law knows one; then the jump is the projection of d onto
            the cone of the gradients, which always exists.
        speed: ``|v-|`` if known, sqrt(J): c was computed from velocities of that size, and has their rounding errors.
        norms: lengths of the rows of Y, shape (h,); computed if None.

    Attributes:
        is_sparse: whether Y is a CSR array.
        lengths: the norms as divisors, with 1 for rows of zeros, shape (h,).
        can_move: whether no gradient is zero.
    """

    def __init__(
        self,
        gradients: Any,
        bound: np.ndarray,
        preimage: np.ndarray | None = None,
        speed: float = 0.0,
        *,
        norms: np.ndarray | None = None,
    ):
        self.gradients, self.bound, self.preimage, self.speed = gradients, bound, preimage, speed
        self.is_sparse = not isinstance(gradients, np.ndarray)
        self.norms = row_lengths(gradients) if norms is None else norms
        self.can_move = np.count_nonzero(self.norms) == len(self.norms)  # takes a quarter of the time of all()
        self.lengths = self.norms if self.can_move else np.where(self.norms > 0, self.norms, 1.0)

    @cached_property
    def scale(self) -> float:
        """The largest of |v-|, |d| and ``|c_i| / |Y_i|``, sqrt(J), with which rounding errors are compared."""
        d = self.preimage
        reach = np.abs(self.bound / self.lengths).max(initial=0.0) if d is None else scipy.linalg.blas.dnrm2(d)
        return max(self.speed, float(reach))

    @cached_property
    def unit(self) -> tuple[Any, np.ndarray]:
        """``Y_i / |Y_i|``, in the form of Y, and ``c_i / |Y_i|``: the same problem with rows of unit length."""
        if not self.is_sparse:
            return self.gradients / self.lengths[:, None], self.bound / self.lengths
        Y = self.gradients
        data = Y.data / np.repeat(self.lengths, np.diff(Y.indptr))
        return scipy.sparse.csr_array((data, Y.indices, Y.indptr), shape=Y.shape), self.bound / self.lengths

    def allows(self, residual: float, tolerance: float) -> bool:
        """Return whether a residual, sqrt(J), is at most tolerance times scale; |v-| often decides it at less cost."""
        return residual <= tolerance * self.speed or residual <= tolerance * self.scale

    def speed_at(self, jump: np.ndarray) -> float:
        """Return the speed with which errors are compared; if |v-| is known, at most the larger of |v-| and |v+|."""
        if self.speed > 0:
            return max(self.speed, 0.5 * sqrt(jump @ jump))
        return max(self.scale, sqrt(jump @ jump))

    def slack(self, z: np.ndarray) -> np.ndarray:
        """Return ``(Y z - c) / |Y_i|``, shape (h,), in sqrt(J); for rows of zeros it is ``-c_i``."""
        return (self.gradients.dot(z) - self.bound) / self.lengths

    def with_gradients(self, gradients: Any) -> Problem:
        """Return the same problem with Y in another form, array or CSR array."""
        return Problem(gradients, self.bound, self.preimage, self.speed, norms=self.norms)


def row_lengths(gradients: Any) -> np.ndarray:
    """Return the lengths of the rows of an array or a CSR array, (h,)."""
    if isinstance(gradients, np.ndarray):
        return np.sqrt(np.vecdot(gradients, gradients))
    return np.sqrt((gradients * gradients).sum(axis=1))


class Status(StrEnum):
    """How a solver ended.

    Attributes:
        SOLVED: the solver considers its impulse a solution.
        INFEASIBLE: the solver found that ``Y z >= c`` has no solution; only a Farkas ray proves it.
        STOPPED: the solver has no solution, or reached its limit of iterations and returns its last iterate.
    """

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    STOPPED = "stopped"


class Solution(NamedTuple):
    """The result of a solver; only the certificate decides whether it is accepted.

    Attributes:
        impulse: ``Lambda``, shape (h,).
        status: how the solver ended.
        iterations: number of iterations, of the solver's own kind; 0 if it does not iterate.
        residual: relative residual that an iterative solver reports; 0 for other solvers.
    """

    impulse: np.ndarray
    status: Status = Status.SOLVED
    iterations: int = 0
    residual: float = 0.0


Solver = Callable[[Problem], Solution]
"""A function from a problem to a solution, which never raises for a problem that it cannot solve."""
