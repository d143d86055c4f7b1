"""Frictionless contacts that stay closed during a smooth phase: which ones, and the impulse that keeps them closed.

A contact is sustained over a phase of duration tau if it was closed at the start and did not separate, or separated
so slowly that its rebound rises less than the gap tolerance: ``gamma^2 / (2 a) <= tolerance`` with a the closing
acceleration in the phase. This also ends a Zeno sequence of ever smaller bounces. The acceleration of a contact is
evaluated again once the contacts below it are held: in a stack that falls freely it is zero.

The phase itself contains no contact except the forces of the last phase (`predicted_force`), whose effect is
subtracted from its end. Then the position is brought back to the closed contacts (`position`), and the velocity v
becomes

    0 <= nu  ⊥  J (w + M^-1 J^T nu) >= 0,   w = v + M^-1 (J_start - J)^T nu' / 2,   v <- w + M^-1 J^T nu

where nu' solves this with w = v. The term with ``J_start - J`` gives half of the impulse the direction at the start of
the phase (as in RATTLE), so that RK4 keeps second order along curved surfaces; on flat surfaces it vanishes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from impactlaw.stepping.event_driven.contact_set import ContactSet
from impactlaw.stepping.event_driven.contact_state import CORRECTED, Phase, PhaseEnd
from impactlaw.stepping.event_driven.persistent_contact.frictional import hold_with_friction
from impactlaw.stepping.event_driven.persistent_contact.position import DetectAgain, hold_position, least_impulse
from impactlaw.stepping.event_driven.persistent_contact.predicted_force import (
    PredictedForce,
    constrained_velocity,
    lasting,
    turned_rows,
)


def hold(
    phase_end: PhaseEnd, phase: Phase, detect_again: DetectAgain
) -> tuple[PhaseEnd, Callable[[], PhaseEnd] | None]:
    """Bring position and velocity back to the sustained contacts; this moves the scene.

    Returns:
        The contacts after the correction, and what remains to be done if the phase is kept: see `hold_with_friction`.
    """
    phase.work.hold(len(phase_end.known))
    if phase_end.now.pattern.friction is not None:
        return hold_with_friction(phase_end, phase, detect_again)
    (now, known, sustained), force, active = phase_end, phase.start.force, phase.start.active
    amiss = now.gap < -CORRECTED * phase.tolerance
    if force is not None and active is not None:
        amiss |= (known >= 0) & active[known] & (now.gap > CORRECTED * phase.tolerance)
    shifts = np.count_nonzero(sustained & amiss) > 0
    if force is None and not shifts and not now.approaches(sustained):
        return phase_end, None
    felt = PredictedForce.of(now.configuration, force, phase.duration)
    free = constrained_velocity(now, phase) - felt.velocity
    if shifts:
        phase_end = hold_position(phase_end, phase, detect_again, felt.shift)
        if force is None and not phase_end.now.approaches(phase_end.sustained):
            return phase_end, None
    return _hold_velocity(phase_end, phase, free, felt), None


def _hold_velocity(phase_end: PhaseEnd, phase: Phase, velocity: np.ndarray, felt: PredictedForce) -> PhaseEnd:
    """Keep closed contacts that are sustained from approaching; return the contacts with the resulting velocity."""
    now, contact_set = phase_end.now, phase_end.now.contact_set
    data = now.configuration.data
    held, active = (phase_end.sustained & now.closed).nonzero()[0], np.zeros(len(now.gap), dtype=bool)
    if not len(held):
        data.qvel[:] = velocity
        return PhaseEnd(now.moving(active), *phase_end[1:])
    nu = _velocity_impulse(contact_set, held, velocity)
    turned = _turned(phase_end, phase, held)
    if turned is not None:
        velocity = velocity + now.configuration.jump(turned, 0.5 * nu)
        nu = _velocity_impulse(contact_set, held, velocity)
    impulse = nu.dot(contact_set.jacobian[held])
    change = now.configuration.velocity(impulse)
    data.qvel[:] = velocity + change
    active[held] = nu > 0
    force = lasting(now.contact_set, impulse / phase.duration) if felt.is_settled(impulse, change) else None
    return PhaseEnd(now.moving(active, force=force), *phase_end[1:])


def _turned(phase_end: PhaseEnd, phase: Phase, held: np.ndarray) -> np.ndarray | None:
    """Return the rows of contacts at the start of the phase minus the current rows, (k, nv); None if they are equal."""
    start, contact_set, known = phase.start.contact_set, phase_end.now.contact_set, phase_end.known[held]
    if not len(start.gap):
        return None
    difference = contact_set.carried(start.jacobian[known], start) - contact_set.jacobian[held]
    difference[known < 0] = 0.0
    return turned_rows(contact_set, difference, contact_set.yielding[held])


def _velocity_impulse(contact_set: ContactSet, held: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return ``nu`` with ``0 <= nu  ⊥  J (v + M^-1 J'^T nu) + w >= 0`` for the held contacts, (k,)."""
    gamma = contact_set.contact_velocity(velocity)[held]
    return least_impulse(contact_set.yielding[held], -gamma)
