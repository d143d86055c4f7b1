"""What an environment says in ``info`` about the collisions of a step: plain numbers, so that they vectorise."""

from __future__ import annotations

from impactlaw.stepping.impact_event import ImpactSums


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
        self._sums = ImpactSums()

    def add(self, sums: ImpactSums) -> None:
        """Take up the collisions of some timesteps."""
        if sums.count:
            self._sums = self._sums.with_more(sums)

    def info(self, *, diverged: bool = False) -> dict[str, int | float]:
        """Return the entries of ``info``."""
        sums = self._sums
        return {
            "impact/count": sums.count,
            "impact/energy_change": sums.energy_change,
            "impact/surface_work": sums.surface_work,
            "impact/intensity": sums.intensity,
            "impact/distant": sums.distant,
            "impact/inadmissible": sums.inadmissible,
            "impact/diverged": int(diverged),
        }
