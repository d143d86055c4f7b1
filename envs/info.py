"""What an environment says in ``info`` about the collisions of a step: plain numbers, so that they vectorise."""

from __future__ import annotations

from collections.abc import Iterable

from impactlaw.stepping.impact_event import ImpactEvent


class ImpactTally:
    r"""Sums up collisions for ``info``.

    | key | meaning | type, unit |
    |---|---|---|
    | ``impact/count`` | collisions | int |
    | ``impact/energy_change`` | sum of T+ - T- | float, J |
    | ``impact/surface_work`` | what moving surfaces did of that, 0 where none moves | float, J |
    | ``impact/intensity`` | sum of \|v+ - v-\| in the kinetic metric | float, sqrt(J) |
    | ``impact/distant`` | collisions with a distant effect (an antidissipative contact) | int |
    | ``impact/inadmissible`` | collisions whose outcome by the law left S(v-) and was projected or let through | int |
    | ``impact/diverged`` | 1 if the simulation left the finite numbers, which ends the episode | int |

    Environments add ``impact/law``, the law in force as text, and ``impact/restitution``, its coefficient, NaN where it
    has not just one (`describe_law`).

    With friction, and under time stepping, restitution that would create energy is scaled instead, so that the outcome
    is in S(v-): such collisions are not among the inadmissible ones (`FrictionImpact.restitution_scale` tells them).
    """

    def __init__(self) -> None:
        self._count = self._distant = self._inadmissible = 0
        self._energy_change = self._surface_work = self._intensity = 0.0

    def add(self, events: Iterable[ImpactEvent]) -> None:
        """Take up the collisions of a timestep."""
        for event in events:
            impact = event.impact
            self._count += 1
            self._energy_change += impact.energy_change
            self._surface_work += impact.surface_work
            self._intensity += impact.intensity
            self._distant += impact.has_distant_effect
            projected = impact.target_contact_velocity is None
            self._inadmissible += projected or not impact.violations.is_admissible()

    def info(self, *, diverged: bool = False) -> dict[str, int | float]:
        """Return the entries of ``info``."""
        return {
            "impact/count": self._count,
            "impact/energy_change": self._energy_change,
            "impact/surface_work": self._surface_work,
            "impact/intensity": self._intensity,
            "impact/distant": self._distant,
            "impact/inadmissible": self._inadmissible,
            "impact/diverged": int(diverged),
        }
