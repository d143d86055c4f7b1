"""Shortcuts for steps that need only one look at contacts, at the end, to see that the last step's answer still holds.

- `Apart`: no contact is near, neither before nor after.
- `Together`: contacts are closed and still without any force, and closed afterwards.
- `Rest`: nothing moved in the last step, and nothing moves in this one if the contacts exert the same forces.

A shortcut is a fact about the last step that may also hold in the next one, which starts where the last one ended. Its
`lasts` tries one smooth phase for the whole step, and returns the shortcut for the step after it. If the condition does
not hold at the end, `lasts` returns None, the phase is undone and the step is taken in the usual way.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw.scene.patterns import Pattern
from impactlaw.stepping.event_driven.contact_state import CORRECTED, SILENT, ContactState
from impactlaw.stepping.event_driven.location.travel import Frames
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases
from impactlaw.stepping.integration import saved_qpos, saved_qvel

_MANY = 100  # number of pairs of geoms that can meet, above which some that are in reach of each other are often apart


@dataclass(frozen=True, eq=False)
class Apart:
    """No contact is near."""

    frames: Frames | None  # frames of all geoms at the start of the step; None if no body can pass through another

    def lasts(self, phases: SmoothPhases) -> Apart | None:
        """Advance by a timestep; return the shortcut for the next one, or None."""
        if not phases.stay_apart(self.frames):
            return None
        return self if self.frames is None else Apart(phases.frames())


@dataclass(frozen=True, eq=False)
class Together:
    """All contacts are closed and were still, which takes no force.

    A contact that begins to approach or to separate is noticed as soon as its gap no longer counts as closed.
    """

    pattern: Pattern  # pattern of these contacts, the only ones that are near
    frames: Frames | None  # frames of all geoms at the start of the step, where they are worth a copy; else None

    def lasts(self, phases: SmoothPhases) -> Together | None:
        """Advance by a timestep; return the shortcut for the next one, or None."""
        if not phases.stay_together(self.pattern, self.frames):
            return None
        return self if self.frames is None else Together(self.pattern, phases.frames())


@dataclass(frozen=True, eq=False)
class Rest:
    """Nothing moves.

    The impulse ``P = M (v+ - v)`` of the contacts in the last phase is known. The next phase gets ``P / tau`` as an
    applied force. If neither position nor velocity has changed at its end, the same contacts are closed, and their
    forces lie in the same cones as before. If geoms were changed meanwhile, the gaps show it.
    """

    qpos: np.ndarray  # configuration at which the contacts were looked at, (nq,)
    force: np.ndarray  # generalized force of the contacts, N or N m, (nv,)
    distance: float  # norm of a displacement below which no gap changes by more than a correction, m or rad
    speed: float  # norm of a velocity below which every contact velocity is rounding, m/s or rad/s
    correction: float  # largest norm of the change of all gaps, m
    pattern: Pattern  # of the contacts
    gaps: np.ndarray  # gaps that MuJoCo has found, m

    def lasts(self, phases: SmoothPhases) -> Rest | None:
        """Advance by a timestep; return the shortcut for the next one, or None."""
        if not phases.is_steady:
            return None
        phases.advance(phases.options.timestep, self.force, still=True)
        data = phases.configuration.data
        moved = _difference(phases, self.qpos, data.qpos)
        if mujoco.mju_norm(moved) <= self.distance and mujoco.mju_norm(data.qvel) <= self.speed:
            phases.leave_contacts(self.pattern)
            gaps = data.contact.dist
            if len(gaps) == len(self.gaps) and mujoco.mju_norm(gaps - self.gaps) <= self.correction:
                return self
        return None


Shortcut = Apart | Together | Rest


def find_together(phases: SmoothPhases, end: ContactState) -> Together | None:
    """Return the shortcut `Together` if contacts stay closed without force at the end of a step, else None.

    All near contacts are then closed, and neither move nor need a correction of position.
    """
    if end.active is not None or end.pattern.friction is not None or not end.pattern.plain:
        return None
    moves = np.abs(end.contact_velocity).max() > SILENT * end.still
    if moves or end.gap.min() < -CORRECTED * phases.tolerance or end.gap.max() > phases.tolerance:
        return None
    return Together(end.pattern, phases.frames() if phases.pairs > _MANY else None)


def is_still(phases: SmoothPhases, velocity: np.ndarray, still: float) -> bool:
    """Return whether all contacts are still at a velocity, (nv,); see `ContactState.still`."""
    return mujoco.mju_norm(velocity) <= SILENT * still / _farthest(phases)


def find_rest(phases: SmoothPhases, state: np.ndarray, end: ContactState) -> Rest | None:
    """Return the shortcut `Rest` if nothing has moved in a step without collisions, else None."""
    configuration, timestep = phases.configuration, phases.options.timestep
    if not is_still(phases, saved_qvel(configuration.model, state), end.still):
        return None
    data, qpos = configuration.data, configuration.data.qpos.copy()
    correction = CORRECTED * phases.tolerance
    distance, speed = correction / _farthest(phases), SILENT * end.still / _farthest(phases)
    if mujoco.mju_norm(_difference(phases, saved_qpos(configuration.model, state), qpos)) > distance:
        return None
    after = configuration.save()
    configuration.restore(state)
    data.qvel[:] = end.velocity  # so that the force does not also undo the rounding that has accumulated
    phases.advance(timestep)
    change = end.velocity - data.qvel
    configuration.restore(after)
    configuration.update()
    phases.leave_contacts(end.pattern)
    force = configuration.momentum(change / timestep)
    return Rest(qpos, force, distance, speed, 2.0 * correction, end.pattern, data.contact.dist.copy())


def _farthest(phases: SmoothPhases) -> float:
    """Return a bound on the relative motion of two points in contact, m per unit of all coordinates together."""
    return 2.0 * max(phases.farthest, 1.0)


def _difference(phases: SmoothPhases, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the displacement from one configuration to another, (nv,)."""
    model = phases.configuration.model
    result = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, result, 1.0, one, other)
    return result
