"""Collisions in a simulation with MuJoCo's own contacts: what it was like before contact, and what it is like after."""

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

_OVERLAP = 1e-12  # m, up to which geoms in touch do not overlap
_REACH = 4.0  # steps of the fastest contact within which the contacts of a collision were closed, or will be
State = tuple[np.ndarray, np.ndarray, float]
"""Positions, velocities and time, s."""


class SoftCollisions:
    """Watches a simulation with soft contacts: a collision lasts from the last state without overlap to the next one.

    MuJoCo's contacts take time. The collision is what they make of the velocity before, at the configuration before:
    v- and v+ are those at the moments when the first contact closes and the last one opens, found from the states
    beside, in which nothing overlaps, with the acceleration there. What other forces do meanwhile is part of the
    outcome. Where something always overlaps, as a body at rest on the floor does, no collisions can be told apart.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._detector = Detector(model)
        self._bilateral = bilateral_constraints(model)
        self._scratch = mujoco.MjData(model)
        self._free: State | None = None
        self._pairs: set[tuple[int, int]] = set()

    def look(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Look at the state after a step, and return the collision that is over with it, if any is.

        Frames and contacts of data are renewed; state and forces are left as they are.
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
        gamma = J @ after[1]
        opens = gamma > 0
        past = np.min(_time(gap[opens], -gamma[opens], (J @ rate)[opens]), initial=np.inf)
        post = after[1] - (past if np.isfinite(past) else 0.0) * rate
        gap, J, rate = self._contacts(before, pairs)
        gamma = J @ velocity
        closes = gamma < 0
        if not closes.any():
            return None
        wait = float(np.min(_time(gap[closes], gamma[closes], (J @ rate)[closes])))
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
        """Return gaps, (h,), gradients, (h, nv), and acceleration without contact, (nv,), of a state beside contact."""
        model, scratch = self._model, self._scratch
        scratch.qpos[:], scratch.qvel[:], scratch.time = state
        mujoco.mj_forward(model, scratch)
        rate = scratch.qacc_smooth.copy()
        speed = np.abs(state[1]).max(initial=0.0) * max(1.0, float(model.stat.extent))
        reach = _REACH * model.opt.timestep * speed + 1e-9
        update_positions(model, scratch)
        found = self._detector.near(scratch, reach).contacts
        mine = np.array([(int(a), int(b)) in pairs for a, b in found.geoms], dtype=bool)
        self._near = found.select(mine)
        mujoco.mj_forward(model, scratch)
        return self._near.gap, gap_gradients(model, scratch, self._near), rate


def _time(gap: np.ndarray, gamma: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return when ``gap + gamma t + rate t^2 / 2 = 0`` first, with gamma < 0; 0 where the gap is not open."""
    gap = np.maximum(gap, 0.0)
    inside = np.maximum(gamma**2 - 2.0 * rate * gap, 0.0)
    return 2.0 * gap / (-gamma + np.sqrt(inside))
