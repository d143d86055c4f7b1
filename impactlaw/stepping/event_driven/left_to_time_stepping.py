"""Contacts and collisions whose step is left to time stepping; each check raises `UnfinishedStepError` for them."""

from __future__ import annotations

import numpy as np

from impactlaw.errors import UnfinishedStepError
from impactlaw.scene.equality_constraints import CALM, are_tied, closing_beside, least_free, lengths
from impactlaw.stepping.collisions import Closed
from impactlaw.stepping.event_driven.contact_state import ContactState
from impactlaw.stepping.event_driven.overlap import clearance, refuse
from impactlaw.stepping.impact_event import ImpactEvent

_LOCKED = 1e2  # ratio h D / M of joint damping to inertia above which contact is not held
_DEEP = 1e3  # largest overlap of held contacts, in gap tolerances
_GAINED = 0.02  # energy that the drift of constraints may add to a collision, relative to that of its velocity jump
_ENDED = 1e-6  # part of the kinetic energy that E = 0 may take after max_events collisions


def check_held(state: ContactState, timestep: float, tolerance: float) -> None:
    """Raise if contact is not held: damping locks joints in a timestep, s, or an overlap is too deep."""
    if len(state.gap) and state.configuration.is_locked(timestep, _LOCKED):
        raise UnfinishedStepError(
            'contact is not held beside joints that damping all but locks; use RK4, or scheme="time-stepping"'
        )
    depth = clearance(state.contact_set)
    if len(depth) and depth.item(depth.argmin()) < -_DEEP * tolerance:
        overlap = refuse(state.contact_set, tolerance, 'smaller timesteps, or scheme="time-stepping", may hold them')
        raise UnfinishedStepError(f"contacts were not held: {overlap}")


def are_bodies_tied(state: ContactState) -> bool:
    """Return whether equality constraints leave a closed contact almost no motion: both cannot be satisfied."""
    constraints, model = state.contact_set.bilateral, state.configuration.model
    if constraints is None:
        return False
    closed = state.closed & (state.pattern.geoms[:, 0] >= 0)
    least = least_free(model, state.pattern.geoms[closed])
    return bool(are_tied(state.contact_set.jacobian[closed], constraints, lengths(model), least).any())


def check_calm(start: ContactState, closed: Closed, rounding: np.ndarray) -> None:
    """Raise if constraints drift too fast next to a collision of these closed contacts: they are giving way."""
    if closed.bilateral is None:
        return
    closing = -start.contact_velocity[start.closed]
    colliding = np.where(closing > rounding, closing, 0.0)
    fastest = closing_beside(closed.bilateral, closed.jacobian, colliding, start.configuration.model.dof_treeid)
    if ((fastest > 0.0) & (np.abs(closed.bilateral @ start.velocity) > CALM * fastest)).any():
        raise UnfinishedStepError("equality constraints give way; smaller timesteps may hold them")


def check_driven(new: list[ImpactEvent]) -> None:
    """Raise if the drift of equality constraints drives a collision, however slow it is."""
    for event in new:
        impact, known = event.impact, event.impact.collision
        driven = known.bilateral_jacobian is not None and known.surface_velocity is None
        if driven and impact.energy_change > 0.5 * _GAINED * impact.intensity**2:
            raise UnfinishedStepError("equality constraints drive bodies into each other")


def check_ended(last: ImpactEvent, timestep: float, acceleration: np.ndarray) -> None:
    """Raise if E = 0 after max_events collisions has taken more energy than rounding.

    The acceleration, (nv,), is that by all forces except contact: what it explains in a timestep, s, may be taken.
    """
    impact = last.impact
    lost, pushed = -impact.energy_change, timestep * impact.collision.metric.norm(acceleration)
    if lost > _ENDED * impact.collision.kinetic_energy and impact.intensity > pushed:
        raise UnfinishedStepError("more collisions in a step than max_events")
