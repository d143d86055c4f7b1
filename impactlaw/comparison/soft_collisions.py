"""Collisions in a simulation with MuJoCo's own contacts, from the states just before and just after contact."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction import Friction
from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import gap_gradients, mass_matrix, update_positions
from impactlaw.scene.detection import Detector
from impactlaw.scene.equality_constraints import bilateral_constraints, bilateral_rows
from impactlaw.scene.friction_rows import find_tangents, learn_friction
from impactlaw.stepping.impact_event import ImpactEvent

_OVERLAP = 1e-12  # m: overlap up to which geoms only touch
_REACH = 4.0  # reach of the search for contacts before and after a collision, in steps at the largest speed
State = tuple[np.ndarray, np.ndarray, float]
"""Positions, velocities and time, s."""


class SoftCollisions:
    """A detector of collisions in a simulation with soft contacts.

    A collision lasts from the last state without overlap to the next state without overlap, since MuJoCo's contacts
    take time. It is described at the configuration before it. v- and v+ are the velocities at the moments when the
    first contact closes and the last one opens, extrapolated from those two states with their accelerations. The effect
    of other forces in the meantime is part of the outcome. If some geoms always overlap, such as those of a body at
    rest on the floor, single collisions cannot be distinguished.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._detector = Detector(model)
        self._bilateral = bilateral_constraints(model)
        self._scratch = mujoco.MjData(model)
        self._free: State | None = None
        self._pairs: set[tuple[int, int]] = set()

    def look(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Read the state after a step, and return the collision that has ended in it, if any.

        Frames and contacts of data are updated; state and forces are not changed.
        """
        update_positions(self._model, data)
        contacts = self._detector.near(data, 0.0).contacts
        overlapping = (contacts.gap < -_OVERLAP) & (contacts.geoms[:, 0] >= 0)
        if overlapping.any():
            self._pairs |= {(int(a), int(b)) for a, b in contacts.geoms[overlapping]}
            return ()
        state, pairs = (data.qpos.copy(), data.qvel.copy(), float(data.time)), self._pairs
        before, self._free, self._pairs = self._free, state, set()
        if before is None or not pairs:
            return ()
        event = self._event(before, state, pairs)
        return () if event is None else (event,)

    def _event(self, before: State, after: State, pairs: set) -> ImpactEvent | None:
        model, (qpos, velocity, time) = self._model, before
        gap, J, rate = self._contacts(after, pairs)
        past = np.min(_time(gap, -J @ after[1], J @ rate, model.opt.timestep), initial=np.inf)
        post = after[1] - (past if np.isfinite(past) else 0.0) * rate
        gap, J, rate = self._contacts(before, pairs)
        wait = float(np.min(_time(gap, J @ velocity, J @ rate, model.opt.timestep), initial=np.inf))
        if not np.isfinite(wait):
            return None
        pre = velocity + wait * rate
        near = self._near
        bilateral = bilateral_rows(model, self._scratch, self._bilateral) if self._scratch.ne else None
        rows = learn_friction(model, near.geoms)
        friction = None
        if rows is not None:
            tangential, _ = find_tangents(model, self._scratch, near, rows, None)
            friction = Friction(tangential, rows.contact, rows.coefficient)
        others: dict[str, Any] = {"labels": near.labels, "bilateral_jacobian": bilateral, "friction": friction}
        collision = Collision(mass_matrix(model, self._scratch), J, pre, **others)
        audit = Impact.observed if friction is None else FrictionImpact.observed
        return ImpactEvent(time + wait, near, audit(collision, post), qpos)

    def _contacts(self, state: State, pairs: set) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gaps, (h,), gradients, (h, nv), and contact-free acceleration, (nv,), of a state without overlap."""
        model, scratch = self._model, self._scratch
        scratch.qpos[:], scratch.qvel[:], scratch.time = state
        mujoco.mj_forward(model, scratch)
        rate = scratch.qacc_smooth.copy()
        h = model.opt.timestep
        speed = (np.abs(state[1]) + h * np.abs(rate)).max(initial=0.0) * max(1.0, float(model.stat.extent))
        reach = _REACH * h * speed + 1e-9
        update_positions(model, scratch)
        found = self._detector.near(scratch, reach).contacts
        mine = np.array([(int(a), int(b)) in pairs for a, b in found.geoms], dtype=bool)
        self._near = found.select(mine)
        mujoco.mj_forward(model, scratch)
        return self._near.gap, gap_gradients(model, scratch, self._near), rate


def _time(gap: np.ndarray, gamma: np.ndarray, rate: np.ndarray, longest: float) -> np.ndarray:
    """Return the first t with ``gap + gamma t + rate t^2 / 2 = 0``: 0 for a gap that is not open, inf if there is none.

    A gap that grows at first, ``gamma >= 0``, turns and closes: if it is open, and up to ``longest``, it can be the one
    sought. One that is not open is of a contact at rest, which does not collide.
    """
    room = np.maximum(gap, 0.0)
    root = np.sqrt(np.maximum(gamma**2 - 2.0 * rate * room, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        turned = np.where((rate < 0) & (gap > _OVERLAP), (gamma + root) / -rate, np.inf)
        return np.where(gamma < 0, 2.0 * room / (root - gamma), np.where(turned <= longest, turned, np.inf))
