"""Soft stepping: MuJoCo keeps contact and friction, the law takes over collisions.

A collision is a contact that MuJoCo's solver acts on and that closes faster than ``rest_speed`` at the start of a
step. The law then gives the velocity that MuJoCo integrates from. The law is frictionless: during the collision the
tangential velocities change only as the normal impulses make them; friction acts before and after, as always.

A step without a collision is `mj_step`, bit for bit. What MuJoCo's contacts do within a step is theirs: a contact that
first touches inside of a step is seen at the start of the next one, and under RK4, whose stages look ahead, it may
have been slowed by up to one step of soft force by then.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import get_mjcb_control, mj_checkAcc, mj_Euler, mj_forwardSkip, mj_implicit, mj_RungeKutta, mj_step1

from impactlaw.collide import Collider
from impactlaw.contacts import active_contacts, closing_speed, gap_gradients, geom_names, kinetic_metric
from impactlaw.errors import DivergenceError
from impactlaw.events import ImpactEvent

_RK4, _EULER = int(mujoco.mjtIntegrator.mjINT_RK4), int(mujoco.mjtIntegrator.mjINT_EULER)
_POSITION, _VELOCITY = int(mujoco.mjtStage.mjSTAGE_POS), int(mujoco.mjtStage.mjSTAGE_VEL)
_ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


class SoftStepping:
    """The algorithm behind ``Stepper(contact_model="soft")``; see there for the options."""

    def __init__(self, model: mujoco.MjModel, collider: Collider, *, rest_speed: float):
        self._model = model
        self._collider = collider
        self._rest_speed = rest_speed
        self._names = geom_names(model)
        self.unlocated = 0

    def step(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Advance by one timestep and return the collisions."""
        if get_mjcb_control() is None:
            mj_step1(self._model, data)
        else:
            self._look(data)
        return self.finish(data)

    def finish(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Do what follows `mj_step1` in a step, and return the collisions.

        Raises:
            DivergenceError: MuJoCo found a state that is not finite, or huge, and has reset the simulation.
        """
        model = self._model
        time = data.time
        events: list[ImpactEvent] = []
        if data.ncon and data.efc_vel.min(initial=0.0) < -self._rest_speed:  # all rows, so a bound and cheap
            stage = self._collide(data, events)
        else:
            stage = _VELOCITY
        mj_forwardSkip(model, data, stage, 0)
        mj_checkAcc(model, data)
        integrator = model.opt.integrator
        if integrator == _RK4:
            mj_RungeKutta(model, data, 4)
        elif integrator == _EULER:
            mj_Euler(model, data)
        else:
            mj_implicit(model, data)
        if data.time <= time:
            raise DivergenceError(f"MuJoCo met a state that is not finite after t = {time:g} s and has reset the simulation")
        return tuple(events)

    def _look(self, data: mujoco.MjData) -> None:
        """Do what `mj_step1` does, except for the control callback: `mj_forwardSkip` calls it."""
        model = self._model
        mujoco.mj_checkPos(model, data)
        mujoco.mj_checkVel(model, data)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_sensorPos(model, data)
        energy = model.opt.enableflags & _ENERGY
        if energy:
            mujoco.mj_energyPos(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_sensorVel(model, data)
        if energy:
            mujoco.mj_energyVel(model, data)

    def _collide(self, data: mujoco.MjData, events: list[ImpactEvent]) -> int:
        """Resolve the collisions of now; return the last stage that is still current."""
        if closing_speed(self._model, data) <= self._rest_speed:
            return _VELOCITY
        contacts = active_contacts(self._model, data, self._names)
        h = len(contacts)
        velocity = self._collider.collide(
            kinetic_metric(self._model, data),
            gap_gradients(self._model, data, contacts),
            contacts,
            data.qvel.copy(),
            approach=np.full(h, self._rest_speed),
            rounding=np.zeros(h),
            time=data.time,
            qpos=data.qpos,
            events=events,
        )
        self.unlocated += len(events) > self._collider.most
        if np.array_equal(velocity, data.qvel):
            return _VELOCITY
        data.qvel[:] = velocity
        return _POSITION
