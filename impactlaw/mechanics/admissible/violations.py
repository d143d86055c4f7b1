"""How far an outcome of a collision is from each of the three sets whose intersection is S(v-)."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from numbers import Real
from typing import Any

import numpy as np

from impactlaw.errors import InvalidCollisionError, UnsolvableLawError
from impactlaw.solvers import Problem, beyond_rounding, nonnegative_combination, solve_with_jump

CRUSHED = "no velocity opens all contacts, surfaces crush what is between them"
"""What an infinite kinematic violation says."""


@dataclass(frozen=True)
class Violations:
    """Distances, in the kinetic metric (sqrt(J)), from v+ to the three sets whose intersection is S(v-).

    Attributes:
        kinematic: to the tangent cone ``{v : J v >= 0}``; positive when contacts penetrate, infinite when that is
            empty: surfaces crush what is between them.
        kinetic: to ``v- + M^-1 J^T Lambda, Lambda >= 0``; positive when contacts pull, or something else acted.
        energetic: to the ball ``|v| <= |v-|``; positive when kinetic energy grew by more than the work of surfaces.
        pre_speed: ``|v-|``, the scale that `is_admissible` compares with.
    """

    kinematic: float
    kinetic: float
    energetic: float
    pre_speed: float

    def is_admissible(self, tol: float = 1e-9) -> bool:
        """Whether no violation exceeds ``tol`` times ``|v-|``; `InvalidCollisionError` if tol is no number."""
        if not isinstance(tol, Real):
            raise InvalidCollisionError(f"tol must be a number, a part of |v-|, got {tol!r}")
        return max(self.kinematic, self.kinetic, self.energetic) <= tol * self.pre_speed

    def __str__(self) -> str:
        """Return which there are, and how large they are, in sqrt(J)."""
        if self.kinematic == np.inf:
            return CRUSHED
        parts = (("kinematic", self.kinematic), ("kinetic", self.kinetic), ("energetic", self.energetic))
        return ", ".join(f"{name} {value:.2g}" for name, value in parts if value > 1e-9 * self.pre_speed) or "none"


def measured(c: Any, jump: np.ndarray, after: np.ndarray, kinetic: float, gain: float, speed: float) -> Violations:
    """Return the violations of a jump ``R^T (v+ - v-)`` and of ``gamma+``, with what `pushed` returns and the scale."""
    before = c.relative_velocity
    z = before + jump
    speeds = sqrt(z @ z) + sqrt(before @ before)
    grown = 2.0 * gain / speeds if speeds > 0 else 0.0
    energetic = np.inf if np.isnan(grown) else max(0.0, grown)  # NaN is infinite energy next to infinite speed
    return Violations(_penetration(c, jump, after), kinetic, energetic, speed)


def pushed(c: Any, jump: np.ndarray, impulse: np.ndarray) -> tuple[float, float]:
    """Return the distance to what pushing contacts reach, sqrt(J), and the energy gained, J, less that of surfaces."""
    if (impulse < 0).any():
        impulse = nonnegative_combination(c.whitened_jacobian, jump)
    gain = float(jump @ (c.whitened_velocity + 0.5 * jump))
    if c.frame_rates is not None:
        gain += float(impulse @ c.frame_rates)
    return imbalance(c, jump, impulse), gain


def imbalance(c: Any, jump: np.ndarray, impulse: np.ndarray) -> float:
    """Return ``|M (v+ - v-) - J^T Lambda|`` (dual kinetic norm), beyond what rounding Lambda to doubles makes of it."""
    left = jump - impulse @ c.whitened_jacobian
    return beyond_rounding(sqrt(left @ left), float(np.abs(impulse) @ c.gradient_norms), larger_speed(c, jump))


def larger_speed(c: Any, jump: np.ndarray) -> float:
    """Return the larger of ``|v-|`` and ``|v+|``, sqrt(J), as seen from the surfaces."""
    return max(c.pre_speed, float(np.linalg.norm(c.relative_velocity + jump)))


def _penetration(c: Any, jump: np.ndarray, after: np.ndarray) -> float:
    """Return the distance from v+ to the tangent cone, ``min |x|, gamma+ + Y x >= 0``, sqrt(J)."""
    if not (after < 0).any():
        return 0.0
    Y = c.whitened_jacobian
    back = None if c.frame_rates is not None else -(c.relative_velocity + jump)
    bound = -after if back is None else Y @ back
    try:
        problem = Problem(Y, bound, back, larger_speed(c, jump), norms=c.gradient_norms)
        jump = solve_with_jump(problem, c.labels, shared=False).jump
    except UnsolvableLawError:
        return np.inf  # crushed
    return sqrt(jump @ jump)
