"""Apply the contact forces of the last step in the smooth phase, so that only a remainder is left to project.

With f the force at the start of a phase of duration tau, its end (q, v) differs from that of a phase without contact by

    d_v = tau M^-1 f,   d_q = c tau d_v,   c = 1/2 (RK4), 1 (semi-implicit)

and the impulses Lambda >= 0 of contact are sought from ``v - d_v`` and ``q - d_q``. If the force was right, they
reproduce the same d_v and d_q, so that nothing moves at all. Otherwise the remainder is smaller by one order of tau,
and so is the error of applying at one configuration an impulse that acts along a whole path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import ContactState, Phase

_LARGEST_TURN = 0.3  # largest turn of a row in one phase, rad


class PredictedForce(NamedTuple):
    """The effect of the applied contact force on a phase."""

    impulse: np.ndarray  # ``tau f``, N s or N m s, (nv,)
    velocity: np.ndarray  # ``tau M^-1 f``, (nv,)
    shift: np.ndarray  # shift of the configuration, (nv,)

    @classmethod
    def of(cls, configuration: Configuration, force: np.ndarray | None, duration: float) -> PredictedForce:
        """Return the effect of a force, see `ContactState.force`; the configuration is at the end of the phase."""
        if force is None:
            nothing = np.zeros(configuration.model.nv)
            return cls(nothing, nothing, nothing)
        impulse = duration * configuration.in_bodies(force)
        velocity = configuration.velocity(impulse)
        return cls(impulse, velocity, moving_part(configuration) * duration * velocity)

    def is_settled(self, impulse: np.ndarray, velocity: np.ndarray) -> bool:
        """Return whether the remainder was smaller than the effect of contact, in the kinetic metric.

        Otherwise the next phase must not apply the force: springs near the stability limit of the integrator respond to
        a force with the opposite sign, so that it would grow from step to step.
        """
        left = (impulse - self.impulse).dot(velocity - self.velocity)
        return bool(left <= impulse.dot(velocity))


def lasting(contact_set: ContactSet, force: np.ndarray) -> np.ndarray:
    """Return a force of contacts, (nv,), as the next phase feels it: torques of `BodyAxes` along those of the world."""
    return contact_set.configuration.body_axes.to_world(force, contact_set.turns)


def turned_rows(contact_set: ContactSet, difference: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
    """Return how rows have turned since the start of a phase, (n, nv); None if they have not.

    Args:
        contact_set: the contacts at the end of the phase.
        difference: rows at the start minus rows at the end, (n, nv); changed in place.
        rows: the whitened rows at the end, (n, nv).
    """
    if not np.count_nonzero(difference):
        return None
    turned = contact_set.whiten(difference)
    change, length = np.vecdot(turned, turned), np.vecdot(rows, rows)
    difference[change > _LARGEST_TURN**2 * length] = 0.0  # another feature of the surface, not curvature
    return difference if np.count_nonzero(change > 1e-24 * length) else None


def moving_part(configuration: Configuration) -> float:
    """Return the part of ``tau M^-1 Lambda`` by which forces that are constant over a phase move the bodies."""
    return 0.5 if configuration.is_rk4 else 1.0


def constrained_velocity(now: ContactState, phase: Phase) -> np.ndarray:
    """Return the velocity at the end of a phase that equality constraints ask for, (nv,).

    MuJoCo finds the forces of constraints with M, and then integrates joint damping D implicitly, with ``M + tau D``.
    Where damping is strong, the velocity that the constraints ask for is missed, and contact would pass the error on
    from joint to joint. Therefore the part that constraints fix is taken from ``v + tau a``, where a is the
    acceleration with which the forces were found.
    """
    velocity, configuration = now.velocity, now.configuration
    if now.contact_set.bilateral is None or configuration.is_rk4:
        return velocity
    wanted = phase.start.velocity + phase.duration * configuration.data.qacc
    return velocity + now.contact_set.along_constraints(wanted - velocity)
