"""What an environment says in ``info`` about the collisions of a step: plain numbers, so that they vectorise."""

from __future__ import annotations

from impactlaw.stepping.impact_event import ImpactSums
from impactlaw.stepping.stepper import Stepper


def steps_short(stepper: Stepper) -> int:
    """Return how many steps so far a stepper has not taken as its law and scheme ask."""
    if stepper.contact_model == "rigid":  # what time stepping takes of event-driven steps is counted by both
        return max(stepper.short_steps, stepper.unlocated)
    return stepper.short_steps + stepper.unlocated


def impact_info(sums: ImpactSums, *, short: int = 0, diverged: bool = False) -> dict[str, int | float]:
    r"""Return the entries of ``info``.

    | key | meaning | type, unit |
    |---|---|---|
    | ``impact/count`` | collisions | int |
    | ``impact/energy_change`` | sum of T+ - T- | float, J |
    | ``impact/surface_work`` | what moving surfaces did of that, and equality constraints that had drifted | float, J |
    | ``impact/intensity`` | sum of \|v+ - v-\| in the kinetic metric | float, sqrt(J) |
    | ``impact/distant`` | collisions with a distant effect (an antidissipative contact) | int |
    | ``impact/inadmissible`` | collisions whose outcome by the law left S(v-): projected, scaled or let through | int |
    | ``impact/short`` | timesteps that missed the law or friction, or the time of a collision (event-driven) | int |
    | ``impact/diverged`` | 1 if the simulation left the finite numbers, which ends the episode | int |

    Environments add ``impact/law``, the law in force as text, and ``impact/restitution``, its coefficient, where it has
    just one (`describe_law`).

    Args:
        sums: over the collisions of the step.
        short: how many of its timesteps `Stepper.short_steps` and `Stepper.unlocated` have counted.
        diverged: whether the simulation has left the finite numbers.
    """
    count, energy_change, surface_work, intensity, distant, inadmissible = sums
    return {
        "impact/count": count,
        "impact/energy_change": energy_change,
        "impact/surface_work": surface_work,
        "impact/intensity": intensity,
        "impact/distant": distant,
        "impact/inadmissible": inadmissible,
        "impact/short": short,
        "impact/diverged": int(diverged),
    }
