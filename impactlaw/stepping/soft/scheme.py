"""Soft stepping: MuJoCo keeps contact and friction, the law takes over collisions.

A contact collides if MuJoCo's solver acts on it and it closes faster than ``rest_speed`` at the start of a step; limits
of joints and tendons, at rad/s or m/s, count as contacts. MuJoCo then integrates from the velocity that the law gives;
equality constraints keep their velocity. Contacts have the friction of the scene in a collision, unless the stepper was
made with ``friction="ignore"``.

A step without a collision is `mj_step`, bit for bit, with two exceptions: a contact would throw bodies back by itself
after the law has opened it (`rebounds`), or a contact touches while damping all but locks a joint (`locked_joints`). In
all other respects MuJoCo's contacts act between collisions as they do in `mj_step`. A contact that first closes within
a step is detected at its end, up to one step too deep.

If MuJoCo's force would push a contact that the law opens, positions change with the velocity (`position_correction`).

MuJoCo gives mocap bodies no velocity. Soft stepping computes one from their motion (`Surfaces`): ``gamma = J v + w``
decides which contacts collide, and how. Between collisions MuJoCo's contacts treat mocap bodies as if they were at rest
where they are at the end of the step.

RK4 looks ahead, which is prevented where a step ends in a collision (`stages`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
from mujoco import (
    get_mjcb_control,
    mj_checkAcc,
    mj_Euler,
    mj_forwardSkip,
    mj_implicit,
    mj_step,
    mj_step1,
)

from impactlaw.errors import DivergenceError
from impactlaw.laws import Law
from impactlaw.laws.restitution.on_contacts import Chosen
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.collisions import Collider
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.integration import STEP_STATE, check_timestep, empty_state, restore_state
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.soft.collisions import NOTHING, VELOCITY, Collisions
from impactlaw.stepping.soft.locked_joints import inertia_of_forces, with_locked_joints
from impactlaw.stepping.soft.rebounds import bounces
from impactlaw.stepping.soft.stages import Stages, find_forces

_RK4, _EULER, _DISCRETE = (int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("RK4", "EULER", "DISCRETE"))
_ENERGY, _COMPARE = int(mujoco.mjtEnableBit.mjENBL_ENERGY), int(mujoco.mjtEnableBit.mjENBL_FWDINV)
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
_BAD = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{name}")) for name in ("QPOS", "QVEL", "QACC")]


class SoftStepping:
    """The algorithm behind ``Stepper(contact_model="soft")``; see there for the options.

    Attributes:
        model: the scene.
        collisions: finds and resolves the collisions.
        collides: whether the scene can have collisions at all.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        collider: Collider,
        plan: Plan,
        *,
        rest_speed: float | None,
        chosen: Chosen | None = None,
    ):
        self.model = model
        self.collisions = Collisions(model, collider, plan, rest_speed=rest_speed, chosen=chosen)
        can_have_limits = model.ntendon > 0 or bool((model.jnt_type != _FREE).any())
        self.collides = plan.detection or can_have_limits
        self._stages, self._start = Stages(model), empty_state(model, STEP_STATE)

    @property
    def unlocated(self) -> int:
        """Number of steps so far with more collisions than the collider allows."""
        return self.collisions.unlocated

    @property
    def short_steps(self) -> int:
        """Number of steps so far whose collisions lost restitution or were left to MuJoCo's contacts; `Collisions`."""
        return self.collisions.short_steps

    @property
    def _surfaces(self) -> Surfaces | None:
        return self.collisions.surfaces

    @property
    def only_in_python(self) -> str | None:
        """The reason why these steps are taken in Python under any law; None if compiled code can take them."""
        if self._surfaces is not None and self._surfaces.run:
            return "belts run"
        if self.model.nflex:
            return "there is a flex"
        if self.collisions.chosen is not None:
            return "the law is for some contacts only"
        return None if self.collisions.collider.solver == "auto" else "a solver was chosen"

    def set_law(self, law: Law) -> None:
        """Use another law for the collisions of the next steps."""
        self.collisions.collider = replace(self.collisions.collider, law=law)

    def step(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Advance by one timestep and return the collisions.

        Raises:
            DivergenceError: MuJoCo met a state that is not finite, or huge; it resets the simulation then.
            SceneError: the timestep is not positive, or not finite.
        """
        model, opt = self.model, self.model.opt
        time, timestep = data.time, opt.timestep
        if not 0.0 < timestep < math.inf:
            check_timestep(timestep)
        count, integrator, surfaces = _bad_states(data), opt.integrator, self._surfaces
        if surfaces is not None:
            surfaces.begin(data, opt.timestep)
        if not self.collides:
            mj_step(model, data)
            events = ()
        else:
            mujoco.mj_getState(model, data, self._start, STEP_STATE)
            try:
                events = self._step_from_start(data, integrator)
            except BaseException:
                self._undo(data, time)
                raise
        _refuse_reset(data, time, count)
        if surfaces is not None:
            surfaces.end(data)
        return events

    def finish(self, data: mujoco.MjData) -> tuple[ImpactEvent, ...]:
        """Take the part of a step that follows `mj_step1`, and return the collisions.

        Without a collision, a rebound or locked joints this is `mj_step2`, bit for bit, except for RK4: `mj_step2`
        would replace it by Euler, whereas here RK4 takes the whole step.

        Raises:
            DivergenceError: MuJoCo met a state that is not finite, or huge; it resets the simulation then.
        """
        if self.model.opt.integrator == _RK4:
            return self.step(data)
        time, count = data.time, _bad_states(data)
        if self._surfaces is not None:
            self._surfaces.begin(data, self.model.opt.timestep)
        mujoco.mj_getState(self.model, data, self._start, STEP_STATE)
        try:
            events, stage = self.collisions.resolve(data) if data.ncon or data.nl else NOTHING
            self._finish_step(data, stage)
        except BaseException:
            if self._undo(data, time):
                self._look(data)
            raise
        _refuse_reset(data, time, count)
        if self._surfaces is not None:
            self._surfaces.end(data)
        return events

    def _undo(self, data: mujoco.MjData, time: float) -> bool:
        """Restore the state at the start of a step, unless the step has ended; return whether it was restored.

        Velocities that the law has changed, or accelerations that are those of this step and not of the last one, would
        make it another step if it were taken again.
        """
        if data.time != time:
            return False
        restore_state(self.model, data, self._start, STEP_STATE)
        return True

    def _step_from_start(self, data: mujoco.MjData, integrator: int) -> tuple[ImpactEvent, ...]:
        """Do what `mj_step` does, but apply the law before forces are computed."""
        model, options = self.model, self.model.opt
        if get_mjcb_control() is None or (integrator == _DISCRETE and not options.disableflags & _NO_ACTUATION):
            mj_step1(model, data)
        else:
            self._look(data)
        contacts = data.ncon + data.nl
        events, stage = self.collisions.resolve(data) if contacts else NOTHING
        contacts = data.ncon + data.nl  # again: positions can have changed
        if integrator == _DISCRETE:  # has no function of its own but mj_step2, which calls no control callback
            self._finish_step(data, stage)
            return events
        added = inertia_of_forces(model, data)
        if added is None or get_mjcb_control() is not None:  # callbacks see the mass matrix as it is
            mj_forwardSkip(model, data, stage, 0)
        elif stage != VELOCITY:
            self._update_velocity(data)
        if added is None:
            held = contacts > 0 and bounces(data) and self.collisions.hold_back(data)
            if held:
                mj_forwardSkip(model, data, VELOCITY, 0)
        else:
            held = self._find_forces(data, added)
        mj_checkAcc(model, data)
        if options.enableflags & _COMPARE:
            mujoco.mj_compareFwdInv(model, data)
        if integrator == _RK4 and not held:  # its stages would compute forces of their own
            events += self._stages.advance(data, self.collisions, touches=contacts > 0)
        else:
            self._integrate(data)
        return events

    def _integrate(self, data: mujoco.MjData) -> None:
        """Advance by Euler or an implicit integrator, as `mj_step2` does."""
        if self.model.opt.integrator in (_EULER, _RK4):
            mj_Euler(self.model, data)
        else:
            mj_implicit(self.model, data)

    def _finish_step(self, data: mujoco.MjData, stage: int) -> None:
        """Take the part of a step after the velocity stage; first update that stage if it is not current."""
        model = self.model
        if stage != VELOCITY:
            self._update_velocity(data)
        added = inertia_of_forces(model, data)
        if added is not None:
            self._find_forces(data, added)
            mj_checkAcc(model, data)
            if self.model.opt.enableflags & _COMPARE:
                mujoco.mj_compareFwdInv(model, data)
            self._integrate(data)
            return
        late = self.model.opt.integrator == _DISCRETE  # computes the springs of contacts only in mj_step2
        if not late and (data.ncon or data.nl) and bounces(data):
            find_forces(model, data)
            self.collisions.hold_back(data)
        mujoco.mj_step2(model, data)

    def _find_forces(self, data: mujoco.MjData, added: np.ndarray) -> bool:
        """Compute forces and the sensors of forces with locked joints; return whether contacts were held back."""
        with with_locked_joints(self.model, data, added):
            find_forces(self.model, data)
            held = bounces(data) and self.collisions.hold_back(data)
            if held:
                find_forces(self.model, data)
            data.flg_rnepost = 0
            mujoco.mj_sensorAcc(self.model, data)
        return held

    def _look(self, data: mujoco.MjData) -> None:
        """Do what `mj_step1` does, except for the control callback: `mj_forwardSkip` calls it."""
        model = self.model
        mujoco.mj_checkPos(model, data)
        mujoco.mj_checkVel(model, data)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_sensorPos(model, data)
        if not data.flg_energypos:
            if model.opt.enableflags & _ENERGY:
                mujoco.mj_energyPos(model, data)
            else:
                data.energy[:] = 0.0
        self._update_velocity(data)

    def _update_velocity(self, data: mujoco.MjData) -> None:
        model = self.model
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_sensorVel(model, data)
        if model.opt.enableflags & _ENERGY and not data.flg_energyvel:
            mujoco.mj_energyVel(model, data)


def _refuse_reset(data: mujoco.MjData, time: float, count: int) -> None:
    """Raise DivergenceError if the time, or the count of bad states, shows that MuJoCo has reset itself."""
    if data.time <= time or _bad_states(data) != count:
        raise DivergenceError(f"MuJoCo met a state that is not finite, or huge, in the step after t = {time:g} s")


def _bad_states(data: mujoco.MjData) -> int:
    """Return how often MuJoCo has met positions, velocities or accelerations that are not finite, or huge."""
    return int(data.warning.number[_BAD].sum())
