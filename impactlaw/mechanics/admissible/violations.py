"""How far an outcome of a collision is from each of the three sets whose intersection is S(v-)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Violations:
    """Distances, in the kinetic metric (sqrt(J)), from v+ to the three sets whose intersection is S(v-).

    Attributes:
        kinematic: to the tangent cone ``{v : J v >= 0}``; positive when contacts penetrate.
        kinetic: to ``v- + M^-1 J^T Lambda, Lambda >= 0``; positive when contacts pull, or something else acted.
        energetic: to the ball ``|v| <= |v-|``; positive when kinetic energy grew by more than the work of surfaces.
        pre_speed: ``|v-|``, the scale that `is_admissible` compares with.
    """

    kinematic: float
    kinetic: float
    energetic: float
    pre_speed: float

    def is_admissible(self, tol: float = 1e-9) -> bool:
        """Whether no violation exceeds ``tol`` times ``|v-|``."""
        return max(self.kinematic, self.kinetic, self.energetic) <= tol * self.pre_speed
