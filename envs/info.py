"""The entries of ``info`` about the collisions of a step: plain numbers, which vectorized environments can stack."""

from __future__ import annotations

from impactlaw.stepping.impact_event import ImpactSums
from impactlaw.stepping.stepper import Stepper


def steps_short(stepper: Stepper) -> int:
    """Return the number of steps so far in which a stepper missed its law or did not locate every collision."""
    if stepper.contact_model == "rigid":  # both count event-driven steps that time stepping has finished
        return max(stepper.short_steps, stepper.unlocated)
    return stepper.short_steps + stepper.unlocated


def impact_info(sums: ImpactSums, *, short: int = 0, diverged: bool = False) -> dict[str, int | float]:
    r"""Return the entries of ``info``.

    | key | meaning | type, unit |
    |---|---|---|
    | ``impact/count`` | collisions | int |
    | ``impact/energy_change`` | sum of T+ - T- | float, J |
    | ``impact/surface_work`` | part of it due to moving surfaces and to drifted equality constraints | float, J |
    | ``impact/intensity`` | sum of \|v+ - v-\| in the kinetic metric | float, sqrt(J) |
    | ``impact/distant`` | collisions with a distant effect (an antidissipative contact) | int |
    | ``impact/inadmissible`` | collisions whose outcome under the law left S(v-): projected, scaled or allowed | int |
    | ``impact/short`` | timesteps that missed the law or friction, or the time of a collision (event-driven) | int |
    | ``impact/diverged`` | 1 if the simulation diverged, which ends the episode | int |

    Environments add ``impact/law``, the law in force as text, and ``impact/restitution``, its coefficient, if it has
    exactly one (`describe_law`).

    Args:
        sums: sums over the collisions of the step.
        short: number of timesteps of the step counted by `Stepper.short_steps` or `Stepper.unlocated`.
        diverged: whether the simulation has diverged.
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
