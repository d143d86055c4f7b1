"""The smooth phase feels the contact forces of the step before as applied forces, and only what is left is projected.

With f the force at the start of a phase of duration tau, its end (q, v) is that of a phase without contact, plus

    d_v = tau M^-1 f,   d_q = c tau d_v,   c = 1/2 (RK4), 1 (semi-implicit)

and the impulses Lambda >= 0 of contact are sought from ``v - d_v`` and ``q - d_q``. Where the force was right they give
back the same d_v and d_q, so that nothing is moved at all; what is left is smaller by one order of tau, and with it the
error of adding at one configuration what acts on a whole path.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import ContactState, Phase

_LARGEST_TURN = 0.3  # rad in one phase
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


class FeltForce(NamedTuple):
    """What the force that a phase has felt has done to it."""

    impulse: np.ndarray  # ``tau f``, N s or N m s, (nv,)
    velocity: np.ndarray  # ``tau M^-1 f``, (nv,)
    shift: np.ndarray  # of the configuration, (nv,)

    @classmethod
    def of(cls, configuration: Configuration, force: np.ndarray | None, duration: float) -> FeltForce:
        """Return what a force, (nv,), has done; the configuration is at the end of the phase."""
        if force is None:
            nothing = np.zeros(configuration.model.nv)
            return cls(nothing, nothing, nothing)
        impulse = duration * force
        velocity = configuration.velocity(impulse)
        return cls(impulse, velocity, moving_part(configuration.model) * duration * velocity)

    def is_settled(self, impulse: np.ndarray, velocity: np.ndarray) -> bool:
        """Return whether less was left to do than contact has done, in the kinetic metric.

        Otherwise the next phase had better feel nothing: springs near the stability limit of the integrator answer to a
        force with another sign, and there it would grow from step to step.
        """
        left = (impulse - self.impulse).dot(velocity - self.velocity)
        return bool(left <= impulse.dot(velocity))


def turned_rows(contact_set: ContactSet, difference: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
    """Return how rows have turned since the start of a phase, (n, nv); None if not at all.

    Args:
        contact_set: the contacts at its end.
        difference: rows at the start less those at the end, (n, nv); changed in place.
        rows: those at the end, whitened, (n, nv).
    """
    if not np.count_nonzero(difference):
        return None
    turned = contact_set.whiten(difference)
    change, length = np.vecdot(turned, turned), np.vecdot(rows, rows)
    difference[change > _LARGEST_TURN**2 * length] = 0.0  # another feature of the surface, not a curved one
    return difference if np.count_nonzero(change > 1e-24 * length) else None


def moving_part(model: mujoco.MjModel) -> float:
    """Return the part of ``tau M^-1 Lambda`` by which forces that are constant over a phase have moved the bodies."""
    return 0.5 if model.opt.integrator == _RK4 else 1.0


def constrained_velocity(now: ContactState, phase: Phase) -> np.ndarray:
    """Return the velocity at the end of a phase as equality constraints had wanted it there, (nv,).

    MuJoCo finds the forces of constraints with M, and then integrates joint damping D implicitly, with ``M + tau D``:
    where damping is strong that misses what was found, and contact would pass the error on from joint to joint. So the
    part that constraints fix is taken from ``v + tau a``, a being the acceleration that they were found with.
    """
    velocity, configuration = now.velocity, now.configuration
    if now.contact_set.bilateral is None or configuration.model.opt.integrator == _RK4:
        return velocity
    wanted = phase.start.velocity + phase.duration * configuration.data.qacc
    return velocity + now.contact_set.along_constraints(wanted - velocity)
