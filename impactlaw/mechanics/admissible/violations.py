"""The distances of an outcome from the three sets whose intersection is S(v-)."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, sqrt
from numbers import Real
from typing import Any

import numpy as np

from impactlaw.errors import InvalidCollisionError, UnsolvableLawError
from impactlaw.solvers import Problem, beyond_rounding, nonnegative_combination, solve_with_jump

CRUSHED = "no velocity opens all contacts, surfaces crush what is between them"
"""The text of an infinite kinematic violation."""


@dataclass(frozen=True)
class Violations:
    """Distances, in the kinetic metric (sqrt(J)), from v+ to the three sets whose intersection is S(v-).

    Attributes:
        kinematic: to the tangent cone ``{v : J v >= 0}``; positive if contacts penetrate, infinite if the set is empty
            because surfaces crush what is between them.
        kinetic: to ``v- + M^-1 J^T Lambda, Lambda >= 0``; positive if contacts pull, or other impulses acted.
        energetic: to the ball ``|v| <= |v-|``; positive if kinetic energy grew by more than the work of surfaces.
        pre_speed: ``|v-|``, the scale that `is_admissible` compares with.
    """

    kinematic: float
    kinetic: float
    energetic: float
    pre_speed: float

    def is_admissible(self, tol: float = 1e-9) -> bool:
        """Whether no violation exceeds ``tol |v-|``; `InvalidCollisionError` if tol is not a number."""
        if not isinstance(tol, Real):
            raise InvalidCollisionError(f"tol must be a number, a part of |v-|, got {tol!r}")
        return max(self.kinematic, self.kinetic, self.energetic) <= tol * self.pre_speed

    def __str__(self) -> str:
        """Return the names of the violations and their sizes in sqrt(J)."""
        if self.kinematic == np.inf:
            return CRUSHED
        parts = (("kinematic", self.kinematic), ("kinetic", self.kinetic), ("energetic", self.energetic))
        return ", ".join(f"{name} {value:.2g}" for name, value in parts if value > 1e-9 * self.pre_speed) or "none"


def measured(c: Any, jump: np.ndarray, after: np.ndarray, kinetic: float, gain: float, speed: float) -> Violations:
    """Return the violations, given ``R^T (v+ - v-)``, ``gamma+``, the results of `pushed`, and the scale ``|v-|``."""
    before = c.relative_velocity
    z = before + jump
    speeds = sqrt(z.dot(z)) + sqrt(before.dot(before))
    grown = 2.0 * gain / speeds if speeds > 0 else 0.0
    energetic = np.inf if isnan(grown) else max(0.0, grown)  # NaN is infinite energy next to infinite speed
    return Violations(_penetration(c, jump, after), kinetic, energetic, speed)


def pushed(c: Any, jump: np.ndarray, impulse: np.ndarray) -> tuple[float, float]:
    """Return the distance to the velocities that pushing contacts can reach, sqrt(J), and the energy gain, J.

    The gain is the change of kinetic energy less the work of moving surfaces.
    """
    if np.count_nonzero(impulse < 0):
        impulse = nonnegative_combination(c.whitened_jacobian, jump)
    gain = float(jump.dot(c.whitened_velocity + 0.5 * jump))
    if c.frame_rates is not None:
        gain += float(impulse @ c.frame_rates)
    return imbalance(c, jump, impulse), gain


def imbalance(c: Any, jump: np.ndarray, impulse: np.ndarray) -> float:
    """Return ``|M (v+ - v-) - J^T Lambda|`` (dual kinetic norm), less what rounding Lambda to doubles may cause."""
    left = jump - c.whitened_jacobian.T.dot(impulse)
    return beyond_rounding(sqrt(left.dot(left)), float(np.abs(impulse).dot(c.gradient_norms)), larger_speed(c, jump))


def larger_speed(c: Any, jump: np.ndarray) -> float:
    """Return the larger of ``|v-|`` and ``|v+|``, sqrt(J), relative to moving surfaces."""
    return max(c.pre_speed, float(np.linalg.norm(c.relative_velocity + jump)))


def _penetration(c: Any, jump: np.ndarray, after: np.ndarray) -> float:
    """Return the distance from v+ to the tangent cone, ``min |x|, gamma+ + Y x >= 0``, sqrt(J)."""
    if not np.count_nonzero(after < 0):
        return 0.0
    Y = c.whitened_jacobian
    back = None if c.frame_rates is not None else -(c.relative_velocity + jump)
    bound = -after if back is None else Y @ back
    try:
        problem = Problem(Y, bound, back, larger_speed(c, jump), norms=c.gradient_norms)
        jump = solve_with_jump(problem, c.labels, shared=False).jump
    except UnsolvableLawError:
        return np.inf
    return sqrt(jump @ jump)
