"""The stages of RK4 in soft stepping: which steps are taken without contacts that are not closed at their start.

The stages look ahead: a contact that they meet would take part of the velocity that the law is to reverse. If the last
stage has met new contacts, or a stage before it had more contacts, which can have kept the last one away, the step is
tried again without them (`without_new_contacts`). If a joint would pass a limit, this is tried first. If the trial ends
in a collision, the law resolves it there, and the trial is the step.
"""

from __future__ import annotations

from collections import Counter

import mujoco
import numpy as np

from impactlaw.scene.contacts import closes, row_velocities
from impactlaw.scratch import Scratch
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.soft.collisions import NOTHING, VELOCITY, Collisions
from impactlaw.stepping.soft.without_new_contacts import (
    TENDON,
    advance_without_new_contacts,
    contact_forces,
    is_plain,
    keep_start,
    passes_limit,
    put_start,
)

_STATE, _ENERGY = int(mujoco.mjtState.mjSTATE_INTEGRATION), int(mujoco.mjtEnableBit.mjENBL_ENERGY)


class Stages:
    """Advances a scene by RK4, and resolves the collisions in which steps end."""

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._before = np.empty(mujoco.mj_stateSize(model, _STATE))
        self._trial = Scratch(model)

    def advance(self, data: mujoco.MjData, collisions: Collisions, *, touches: bool) -> tuple[ImpactEvent, ...]:
        """Advance by RK4 after `mj_forward`; return the collisions in which the step ends.

        Whether new contacts of the last stage close is not checked if an earlier stage has met more contacts, which can
        have kept bodies away from the last ones.
        """
        model = self._model
        mujoco.mj_getState(model, data, self._before, _STATE)
        start, pushing = keep_start(data, touches=touches), contact_forces(model, data) if touches else None
        if passes_limit(model, data):
            events = self._collide_at_end(data, collisions, start, pushing, data.contact.geom.copy())
            if not events:
                mujoco.mj_RungeKutta(model, data, 4)
            return events
        before = _met(data)
        most = _runge_kutta(model, data)
        between = most > data.nefc
        if between and most <= len(before[1]):  # most likely a contact has opened
            between = _will_meet_more(model, self._at_start(start), before)
        if not between:
            if all(np.array_equal(*pair) for pair in zip(_met(data), before, strict=True)):
                return ()
            velocities = row_velocities(model, data, self._before[1 + model.nq :][: model.nv])
            still = collisions.surfaces is None or collisions.surfaces.still
            if still and not closes(model, data, velocities, collisions.rest_speed):
                return ()
        return self._collide_at_end(data, collisions, start, pushing, before[0])

    def _at_start(self, start: tuple[np.ndarray, ...]) -> mujoco.MjData:
        """Return other data as at the start of the step; see `keep_start`."""
        model, trial = self._model, self._trial.data
        mujoco.mj_setState(model, trial, self._before, _STATE)
        if is_plain(model):
            put_start(trial, start)
        else:
            _update(model, trial)
        return trial

    def _collide_at_end(
        self,
        data: mujoco.MjData,
        collisions: Collisions,
        start: tuple[np.ndarray, ...],
        pushing: np.ndarray | None,
        pairs: np.ndarray,
    ) -> tuple[ImpactEvent, ...]:
        """Take an RK4 step without new contacts in other data; keep it if it ends in a collision that the law changes.

        Args:
            data: the state, which becomes that at the end of the step.
            collisions: resolves them.
            start: see `keep_start`.
            pushing: the forces of contacts and limits at the start of the step, (nv,); None if nothing touches.
            pairs: the geoms of the contacts at the start of the step, int32 (n, 2).
        """
        model, trial = self._model, self._at_start(start)
        advance_without_new_contacts(model, trial, pushing=pushing)
        mujoco.mj_fwdPosition(model, trial)
        mujoco.mj_fwdVelocity(model, trial)
        events, stage = collisions.resolve(trial, pairs) if trial.ncon or trial.nl else NOTHING
        if stage == VELOCITY:
            return ()
        mujoco.mj_getState(model, trial, self._before, _STATE)
        mujoco.mj_setState(model, data, self._before, _STATE)
        _update(model, data)  # as after mj_step, which leaves what its last stage has met at the end of the step
        if model.opt.enableflags & _ENERGY:
            mujoco.mj_energyPos(model, data)
            mujoco.mj_energyVel(model, data)
        return events


def _update(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Do what `mj_forward` does, except for sensors, energies and the control callback."""
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    find_forces(model, data)


def find_forces(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute accelerations and contact forces."""
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)
    mujoco.mj_fwdConstraint(model, data)


def _runge_kutta(model: mujoco.MjModel, data: mujoco.MjData) -> int:
    """Advance by RK4 after `mj_forward`; return the largest number of constraint rows of the stages after the first.

    This is read from ``maxuse_efc``, MuJoCo's largest number of rows so far, which gets its right value afterwards.
    """
    so_far, data.maxuse_efc = data.maxuse_efc, 0
    mujoco.mj_RungeKutta(model, data, 4)
    most = data.maxuse_efc
    data.maxuse_efc = max(so_far, most)
    return most


def _met(data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return the pair of geoms of each contact, int32 (ncon, 2), and numbers that identify the constraint rows."""
    return data.contact.geom.copy(), 8 * data.efc_id + data.efc_type


def _will_meet_more(model: mujoco.MjModel, data: mujoco.MjData, before: tuple[np.ndarray, np.ndarray]) -> bool:
    """Return whether contacts or limits that are not there at the start of a step are at ``q + h v + h^2 a / 2``.

    Args:
        model: the scene.
        data: other data than the user's, with position, velocity and acceleration of the start; changed.
        before: what has `_met` at the start.
    """
    h = model.opt.timestep
    mujoco.mj_integratePos(model, data.qpos, data.qvel + 0.5 * h * data.qacc, h)
    mujoco.mj_fwdPosition(model, data)
    pairs, rows = _met(data)
    limits = rows[data.ne + data.nf :][: data.nl]
    more = Counter(map(tuple, pairs.tolist())) - Counter(map(tuple, before[0].tolist()))
    new = (limits % 8 == TENDON) | ~np.isin(limits, before[1])  # both limits of a tendon have the same number
    return bool(more) or bool(np.count_nonzero(new))
