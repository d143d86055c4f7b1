"""The one problem every solver answers, the form of an answer, and the measure of how good it is."""

from __future__ import annotations

from enum import StrEnum
from math import sqrt
from typing import Any, NamedTuple, Protocol

import numpy as np

from impactlaw import deferred

FEW = 40
"""Contacts up to which numbers are few enough for Python's own loops, and all of G is wanted."""


class Problem:
    """``min |z|^2 / 2  subject to  Y z >= c``: the smallest velocity jump that reaches the wanted contact velocities.

    Its optimality conditions are the impact law: ``z = Y^T Lambda`` and ``0 <= Lambda  ⊥  Y z - c >= 0``.

    Args:
        gradients: ``Y``, the gap gradients where the kinetic metric is Euclidean, shape (h, nv); may be a CSR array.
        bound: ``c = gamma^h - gamma-``, shape (h,).
        preimage: ``d`` with ``Y d = c`` where the law knows one, shape (nv,); then the jump is the projection of d
            onto the cone of the gradients, which always exists.
        times: d is so many times the given one, multiplied when it is first asked for.
        speed: ``|v-|`` where it is known, sqrt(J): c was computed from it and carries its rounding.
        norms: lengths of the rows of Y, shape (h,), where they are known.
        scale: the attribute, where it is known: no less than |v-|.
        delassus: ``G = Y Y^T``, shape (h, h), where it is known.

    Attributes:
        is_sparse: whether Y is a CSR array.
        lengths: the norms, to divide by: 1 for rows of zeros, shape (h,).
    """

    __slots__ = (
        "_preimage",
        "_scale",
        "_times",
        "_transposed",
        "bound",
        "delassus",
        "gradients",
        "is_sparse",
        "lengths",
        "norms",
        "speed",
    )

    is_sparse: bool
    norms: np.ndarray
    lengths: np.ndarray

    def __init__(
        self,
        gradients: Any,
        bound: np.ndarray,
        preimage: np.ndarray | None = None,
        speed: float = 0.0,
        *,
        times: float | None = None,
        norms: np.ndarray | None = None,
        scale: float | None = None,
        delassus: Any = None,
    ):
        self.gradients, self.bound, self.speed, self.delassus = gradients, bound, speed, delassus
        self.is_sparse = not isinstance(gradients, np.ndarray)
        self.norms = known = row_lengths(gradients) if norms is None else norms
        self.lengths = known if np.count_nonzero(known) == len(known) else np.where(known > 0, known, 1.0)
        self._preimage, self._times = preimage, times
        self._transposed: Any = None
        self._scale = scale

    @property
    def scale(self) -> float:
        """Largest of |v-|, |d| and ``|c_i| / |Y_i|``, sqrt(J): a jump is called rounding in comparison with it."""
        if self._scale is None:
            d = self.preimage
            if d is not None:
                reach = sqrt(d.dot(d))
            else:
                reach = max(map(abs, (self.bound / self.lengths).tolist()), default=0.0)
            self._scale = max(self.speed, reach)
        return self._scale

    @property
    def preimage(self) -> np.ndarray | None:
        """``d`` with ``Y d = c``, shape (nv,), where the law knows one: the jump is then its projection on the cone."""
        if self._times is not None and self._preimage is not None:
            self._preimage, self._times = self._times * self._preimage, None
        return self._preimage

    @property
    def transposed(self) -> Any:
        """``Y^T``, in the form of Y; that of a CSR array is made once."""
        if self._transposed is None:
            self._transposed = self.gradients.T
        return self._transposed

    def speed_at(self, jump: np.ndarray) -> float:
        """What errors are compared with: where |v-| is known, never more than the larger of |v-| and |v+|."""
        if self.speed > 0:
            return max(self.speed, 0.5 * sqrt(jump.dot(jump)))
        return max(self.scale, sqrt(jump.dot(jump)))

    def slack(self, z: np.ndarray) -> np.ndarray:
        """``(Y z - c) / |Y_i|``, shape (h,), in sqrt(J); rows of zeros count as ``-c_i``."""
        return (self.gradients.dot(z) - self.bound) / self.lengths

    def with_gradients(self, gradients: Any) -> Problem:
        """Return the same problem with the same Y in another form."""
        return Problem(gradients, self.bound, self.preimage, self.speed, norms=self.norms, scale=self.scale)


def row_lengths(gradients: Any) -> np.ndarray:
    """Return the lengths of the rows of an array or a CSR array, (h,)."""
    if isinstance(gradients, np.ndarray):
        return np.sqrt(np.vecdot(gradients, gradients))
    squares = gradients.data * gradients.data
    return np.sqrt(np.bincount(row_numbers(gradients), weights=squares, minlength=gradients.shape[0]))


def row_numbers(gradients: Any) -> np.ndarray:
    """Return the row of each entry of a CSR array, (entries,)."""
    return np.repeat(np.arange(gradients.shape[0]), np.diff(gradients.indptr))


def natural_residual(problem: Problem, impulse: np.ndarray) -> float:
    """Return the length of the natural map ``min(Lambda_i |Y_i|, slack_i)``, relative to the scale of the problem."""
    natural = np.minimum(impulse * problem.lengths, problem.slack(problem.transposed.dot(impulse)))
    length = sqrt(natural.dot(natural))
    return length / problem.scale if problem.scale > 0 else length


def row_scaled(gradients: Any, lengths: np.ndarray) -> Any:
    """Return the rows divided by the lengths, in the form of the gradients."""
    if isinstance(gradients, np.ndarray):
        return gradients / lengths[:, None]
    data = gradients.data / lengths[row_numbers(gradients)]
    return deferred.csr_array((data, gradients.indices, gradients.indptr), shape=gradients.shape)


def sparse(gradients: Any) -> Any:
    """Return the gradients as a CSR array."""
    return gradients if not isinstance(gradients, np.ndarray) else deferred.csr_array(gradients)


class Status(StrEnum):
    """How a solver ended.

    Attributes:
        SOLVED: with what it holds for the answer.
        INFEASIBLE: it finds that ``Y z >= c`` has no solution; only a Farkas ray proves that.
        STOPPED: without an answer, or at a bound on its iterations with what it has reached.
    """

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    STOPPED = "stopped"


class Solution(NamedTuple):
    """What a solver hands back; only the certificate decides whether it is an answer.

    Attributes:
        impulse: ``Lambda``, shape (h,).
        status: how the solver ended.
        iterations: of the solver's own kind; 0 when it takes none.
        residual: what an iterative solver itself says that it reached, relative; 0 for the others.
    """

    impulse: np.ndarray
    status: Status = Status.SOLVED
    iterations: int = 0
    residual: float = 0.0


class Solver(Protocol):
    """A solver is a function from a problem to a solution; it never raises for a problem that it cannot solve."""

    def __call__(self, problem: Problem) -> Solution:
        """Solve one problem."""
        ...
