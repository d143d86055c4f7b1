"""The point of maximal dissipation, E = 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from impactlaw.errors import RestitutionError
from impactlaw.laws.base import RestitutionLaw


@dataclass(frozen=True)
class MaximalDissipation(RestitutionLaw):
    """``E = 0``: v+ is the point of S(v-) of least energy, the projection of v- onto the tangent cone ``J v >= 0``.

    That is ``0 <= Lambda  ⊥  gamma+ >= 0``, or ``min |v+ - v-|`` subject to ``J v+ >= 0``, in the kinetic metric: the
    point of maximal dissipation (Aeberhard and Glocker, "Perfect multi-contact collisions").
    """

    name = "maximal-dissipation"
    description = "E = 0: the least kinetic energy that no penetration allows; takes no restitution"
    takes_restitution = False

    @classmethod
    def of(cls, restitution: Any) -> MaximalDissipation:
        """Return the law; the only restitution that it accepts is 0."""
        if restitution is not None and (getattr(restitution, "ndim", 0) or restitution != 0):
            raise RestitutionError(f"law {cls.name!r} has restitution 0, got {restitution!r}; leave it out")
        return cls()

    @property
    def common_coefficient(self) -> float:
        """Zero."""
        return 0.0
