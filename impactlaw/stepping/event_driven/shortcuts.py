"""Steps whose contacts need no look but one at the end, to see that the last step's answer holds once more.

- `Apart`: nothing is near, neither before nor after.
- `Together`: contacts are closed, and still, without any force; they are closed after.
- `Rest`: nothing has moved in the last step, and nothing moves in this one if the contacts exert the same forces.

A shortcut tries one smooth phase for the whole step. Where its condition does not hold at the end, that is taken back,
and the step taken as any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from impactlaw.scene.patterns import Pattern
from impactlaw.stepping.event_driven.contact_state import CORRECTED, SILENT, ContactState
from impactlaw.stepping.event_driven.location.travel import Frames
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases
from impactlaw.stepping.integration import saved_qpos, saved_qvel


class Shortcut(Protocol):
    """What the last step has shown, and whether it holds in the next one, too, which starts where that has ended."""

    def lasts(self, phases: SmoothPhases) -> Shortcut | None:
        """Advance by a timestep; return the shortcut of the next one, or None if this one is to be taken back."""
        ...


@dataclass(frozen=True, eq=False)
class Apart:
    """No contact is near."""

    frames: Frames | None  # of all geoms at the start of the step; None if no body can pass through another

    def lasts(self, phases: SmoothPhases) -> Shortcut | None:
        """See `Shortcut`."""
        return Apart(phases.frames()) if phases.stay_apart(self.frames) else None


@dataclass(frozen=True, eq=False)
class Together:
    """All contacts are closed and were still, and no force is needed for that.

    One that begins to approach or to separate is noticed as soon as its gap is not closed any more.
    """

    pattern: Pattern  # of these contacts, the only ones near

    def lasts(self, phases: SmoothPhases) -> Shortcut | None:
        """See `Shortcut`."""
        return self if phases.stay_together(self.pattern) else None


@dataclass(frozen=True, eq=False)
class Rest:
    """Nothing moves.

    The impulse ``P = M (v+ - v)`` of the contacts in the last phase is known. The next one gets ``P / tau`` as an
    applied force. If nothing has moved at its end, neither in position nor in velocity, the same contacts are
    closed, and their forces lie in the same cones as before, unless somebody has changed geoms: that shows in gaps.
    """

    qpos: np.ndarray  # where the contacts were looked at, (nq,)
    force: np.ndarray  # that the contacts exert on all degrees of freedom, N or N m, (nv,)
    distance: float  # of all coordinates together, below which no gap changes by more than a correction, m or rad
    speed: float  # of all coordinates together, below which every contact velocity is rounding, m/s or rad/s
    correction: float  # of gaps, all together, m
    pattern: Pattern  # of the contacts
    gaps: np.ndarray  # that MuJoCo has found, m

    def lasts(self, phases: SmoothPhases) -> Shortcut | None:
        """See `Shortcut`."""
        if not phases.is_steady:
            return None
        phases.advance(phases.options.timestep, self.force)
        data = phases.configuration.data
        moved = _difference(phases, self.qpos, data.qpos)
        if mujoco.mju_norm(moved) <= self.distance and mujoco.mju_norm(data.qvel) <= self.speed:
            phases.leave_contacts(self.pattern)
            gaps = data.contact.dist
            if len(gaps) == len(self.gaps) and mujoco.mju_norm(gaps - self.gaps) <= self.correction:
                return self
        return None


def find_together(end: ContactState) -> Together | None:
    """Return that contacts stay together by themselves if they do so at the end of a step; None if they do not."""
    return Together(end.pattern) if end.quiet and end.pattern.plain else None


def is_still(phases: SmoothPhases, velocity: np.ndarray, still: float) -> bool:
    """Return whether all contacts are still at a velocity, (nv,); see `ContactState.still`."""
    return mujoco.mju_norm(velocity) <= SILENT * still / _farthest(phases)


def find_rest(phases: SmoothPhases, state: np.ndarray, end: ContactState) -> Rest | None:
    """Return the rest that a step without collisions was; None if something has moved in it."""
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
    data.qvel[:] = end.velocity  # the force is not to undo once more what rounding has added up to
    phases.advance(timestep)
    change = end.velocity - data.qvel
    configuration.restore(after)
    phases.leave_contacts(end.pattern)
    force = configuration.momentum(change / timestep)
    return Rest(qpos, force, distance, speed, 2.0 * correction, end.pattern, data.contact.dist.copy())


def _farthest(phases: SmoothPhases) -> float:
    """Return how much two points in contact can move against each other, m per unit of all coordinates together."""
    return 2.0 * max(phases.farthest, 1.0)


def _difference(phases: SmoothPhases, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the displacement from one configuration to another, (nv,)."""
    model = phases.configuration.model
    result = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, result, 1.0, one, other)
    return result
