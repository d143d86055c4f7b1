"""Time stepping after Moreau and Jean: in every step one detection of contacts, and one problem for all of them.

With the timestep h, the integrator's mass matrix ``M_h`` and everything evaluated at the midpoint ``q_M``:

    q_M = q ⊕ (h / 2) v
    v_free = v + h M_h^-1 f(q_M, v)                          MuJoCo's integrator without contact
    0 <= Lambda  ⊥  J v+ - gamma^h >= 0,  v+ = v_free + M_h^-1 J^T Lambda      and friction in its cones
    q+ = q_M ⊕ ((h / 2) v+ + h w)                            w opens overlaps, separately from the velocities

(J. J. Moreau, *Numerical aspects of the sweeping process*, Comput. Methods Appl. Mech. Eng. 177, 1999; M. Jean, same
volume.) ``gamma^h`` is the law's target for colliding contacts (`targets`), and half the turn of the gradient for
persistent contacts (`gradient_turns`). The work of contact in a step is ``Lambda^T (gamma- + gamma+) / 2``, and
forces that do not depend on velocity do their work to second order. Therefore contact creates no energy, and an elastic
ball keeps its energy exactly.

A contact that is hit only through others, across a gap that is still open, collides after them in the same step,
starting from the velocity after their collision (`problem.phases`).

No step fails: if the law cannot be met, the step ends at the nearest point, and ``shortfall`` gives the deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.errors import DivergenceError
from impactlaw.laws import Law
from impactlaw.laws.fremond import Reversal
from impactlaw.scene.moving_surfaces import LastMotion, Surfaces
from impactlaw.stepping.compatibility import check_time_stepping, refuse_override
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.compiled.layout import empty_stack
from impactlaw.stepping.compiled.shared import EngineError
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.integration import check_input, empty_state, restore_state, save_state
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.time_stepping.compiled.end_of_step import begins_overlapping
from impactlaw.stepping.time_stepping.compiled.ending import end_step, finish
from impactlaw.stepping.time_stepping.compiled.far_contacts import take_far_back
from impactlaw.stepping.time_stepping.compiled.midpoint import (
    detect_farther,
    detect_limits,
    free_step,
    outrun,
    to_midpoint,
)
from impactlaw.stepping.time_stepping.compiled.model_copy import room
from impactlaw.stepping.time_stepping.compiled.state.status import FINE
from impactlaw.stepping.time_stepping.compiled.state.surfaces import last_motion, put_motion
from impactlaw.stepping.time_stepping.compiled.state.world import World
from impactlaw.stepping.time_stepping.contact_impulses import ContactProblem
from impactlaw.stepping.time_stepping.events import CollisionRecord, events_of
from impactlaw.stepping.time_stepping.inertial_forces import InertialForces
from impactlaw.stepping.time_stepping.problem.forces import listed_stage
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_turns
from impactlaw.stepping.time_stepping.problem.rows import Known, Rows
from impactlaw.stepping.time_stepping.problem.solution.scaling import RESERVE
from impactlaw.stepping.time_stepping.problem.tiny_gaps import TOUCHING
from impactlaw.stepping.time_stepping.temporary_options import TemporaryOptions
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, MANY_ROUNDS, WIDER_DETECTIONS
from impactlaw.stepping.time_stepping.working_set import Outcome, WorkingSet
from impactlaw.stepping.time_stepping.world import WorldMemory, errors_of_callbacks

_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
_INTEGERS, _NUMBERS = np.zeros((4, 0), np.int32), np.zeros((7, 0))
_NO_ROWS = Rows(_INTEGERS[:3], _INTEGERS[0], _NUMBERS[0], _INTEGERS, np.zeros(0, np.int64), _NUMBERS[:2], _NUMBERS)


class TimeStepping:
    """The algorithm behind ``Stepper(contact_model="rigid", scheme="time-stepping")``; see there for the options.

    The only other option is ``touching``, the gap, m or rad, up to which bodies at rest touch.

    Attributes:
        model: the scene.
        problem: the contact problem, which finds impulses, with the law and the properties of contacts.
        shortfall: largest amount by which a normal contact velocity of the last step misses the law, m/s or rad/s.
        short_steps: see `Stepper.short_steps`; further steps are counted for which MuJoCo had no room for all contacts,
            or in which contacts were left out that a collision closes.
        solved: whether the last step with contact is not among these steps, apart from friction that was not found.
        unlocated: always 0, since no collision is located.
        inertial: Coriolis and gyroscopic forces.
        carriers: the mocap body that carries each geom, see `Surfaces`, int32 (ngeom,).
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law,
        plan: Plan,
        *,
        friction: Literal["coulomb", "convex", "ignore"],
        on_inadmissible: Literal["raise", "project", "allow"],
        rest_speed: float | None,
        touching: float = TOUCHING,
    ):
        check_time_stepping(model)
        self.model, self._touching = model, touching
        self.problem = ContactProblem(
            model, law, friction=friction, on_inadmissible=on_inadmissible, rest_speed=rest_speed
        )
        self._friction = plan.friction
        surfaces = Surfaces(model, plan.pairs.geoms) if plan.surfaces and model.nmocap else None
        self._surfaces = 0.0 if surfaces is None else 1.0 + surfaces.meet
        self.carriers = np.full(model.ngeom, -1, np.int32) if surfaces is None else surfaces.carrier
        self._options = TemporaryOptions(model)
        self._memory = WorldMemory(model, self.carriers)
        self._room = np.empty(11 * model.nbody + max(room(model), 3 * model.nv))
        self.inertial = InertialForces(model)
        self._listed = listed_stage(model)
        self._state = empty_state(model)
        self._left: tuple[bytes, ...] = ()
        self._frames: tuple[bytes, ...] = ()
        self._known: Known | None = None
        self._collisions: tuple[CollisionRecord, ...] = ()
        self._middle, self._velocity = np.zeros(0), np.zeros(0)
        self._gained = np.zeros(model.nv)  # change of velocity by forces in the last step, without contact
        self._held = np.zeros(model.nv)  # change of velocity by contact in the last step, if nothing collided
        self.shortfall, self.short_steps, self.unlocated = 0.0, 0, 0
        self.solved, self._overflown = True, False

    def set_law(self, law: Law) -> None:
        """Use another law for the collisions of the next steps."""
        self.problem = self.problem.under(law)

    def coefficients(self) -> Coefficients:
        """Return a table of the law's coefficients, initially empty."""
        problem = self.problem
        return Coefficients(problem.targets, problem.names, problem.limits, self.model.njnt)

    @property
    def last_motion(self) -> LastMotion | None:
        """Motion of mocap bodies in the last step; None if they move no surfaces."""
        return last_motion(self._memory.motion, self.model) if self._surfaces else None

    def move_on(self, motion: LastMotion | None) -> None:
        """Set the motion of mocap bodies in the last step."""
        if self._surfaces:
            put_motion(self._memory.motion, self.model, motion)

    def take_surfaces(self, surfaces: Surfaces) -> None:
        """Continue with these surfaces, moved by mocap bodies, if the scene has any."""
        self.move_on(surfaces.last_motion)

    def resume(
        self, data: mujoco.MjData, known: Known, gained: np.ndarray, motion: LastMotion | None, *, solved: bool
    ) -> None:
        """Continue from data as if the last step had been one of this scheme.

        Args:
            data: the state at the end of that step; its frames become current.
            known: groups, keys, coefficients of friction and impulses of that step.
            gained: change of velocity in that step by forces without contact, and by contact if nothing collided, (2,
                nv).
            motion: motion of mocap bodies in that step.
            solved: whether that step has met the law.
        """
        with self._options:
            _update_frames(self.model, data)
        self._leave(data)
        self._known, self._gained, self.solved = known if len(known.key) else None, gained[0].copy(), solved
        self._held = gained[1].copy()
        self.move_on(motion)

    def settings(self) -> tuple[float, ...]:
        """Return the options in the form of compiled code, see `compiled.state.world.Settings`."""
        targets = self.problem.targets
        return (
            *self.problem.settings(),
            float(self._friction),
            float(self.inertial.act),
            float(self._options.sticks),
            1.0,
            np.nan if targets.restitution is None else targets.restitution,
            targets.law.restitution if isinstance(targets.law, Reversal) else np.nan,
            self._surfaces,
            0.0,
            float(self._options.stands),
            float(self._listed),
            self.problem.meter,
            float(self._options.beside),
            self._touching,
        )

    def step(self, data: mujoco.MjData) -> Callable[[], tuple[ImpactEvent, ...]] | tuple[()]:
        """Advance by one timestep; return a function for its collisions, or (). After an error, data is as before."""
        model = self.model
        state, motion = save_state(model, data, self._state), self.last_motion
        kept = self._known, self._gained, self._held, self.solved, self.short_steps
        check_input(model, data, state)
        if self._friction:
            refuse_override(model)
        self.inertial.look()
        try:
            with errors_of_callbacks(), self._options:
                self._step(data)
            return self._events()
        except BaseException as error:
            empty_stack(data)
            restore_state(model, data, state)
            mujoco.mj_fwdPosition(model, data)
            self._known, self._gained, self._held, self.solved, self.short_steps = kept
            self.move_on(motion)
            if isinstance(error, EngineError):
                raise self._memory.error() from None
            raise

    def _events(self) -> Callable[[], tuple[ImpactEvent, ...]] | tuple[()]:
        """Return a function that returns the collisions of the last step, or ()."""
        return partial(events_of, self._collisions) if self._collisions else ()

    def _step(self, data: mujoco.MjData) -> None:
        model, options, inertial = self.model, self._options, self.inertial
        self._collisions, self.shortfall = (), 0.0
        same = (data.qpos.tobytes(), data.qvel.tobytes()) == self._left
        if not same or _frames_of(data) != self._frames:
            _update_frames(model, data)
        if not same:
            self._known, self._gained, self._held = None, np.zeros(model.nv), np.zeros(model.nv)
        w = self._memory.world(data, self.settings(), damped=options.damped)
        start, self._velocity, self._middle = data.qpos.copy(), np.empty(model.nv), np.empty(model.nq)
        self._overflown = for_python(to_midpoint)(w, self._gained, self._velocity, self._middle, self._room)
        control = mujoco.get_mjcb_control()
        if control is not None and not model.opt.disableflags & _NO_ACTUATION:
            control(model, data)
        forces, self._gained = (inertial.turning, inertial.gravity), np.empty(model.nv)
        inertial.turning[:] = False
        for_python(free_step)(w, self._velocity, self._held, inertial.used, *forces, self._gained, self._room)
        free, self._held = data.qvel.copy(), np.zeros(model.nv)
        if for_python(take_far_back)(w, self._velocity):
            self._overflown |= for_python(detect_limits)(w, self._velocity, free, self._middle)
        if data.nefc:
            self._contact(w, data, free, start if same else None)
        else:
            self._known, self.solved, data.ncon = None, self.solved and not self._overflown, 0
            self.short_steps += self._overflown
            self._end(w, data, None, met=False)
        for_python(finish)(w, start, self._velocity, *forces)
        self._leave(data)

    def _end(self, w: World, data: mujoco.MjData, outcome: Outcome | None, *, met: bool) -> bool:
        """Move data to the end of the step; return whether new overlaps remain there."""
        found, rows = outcome and outcome.impulses, outcome.rows if outcome else _NO_ROWS
        impulse, shift = (found.answer.impulse, found.answer.shift) if found else (np.zeros(0), np.zeros(0))
        status, remains = for_python(end_step)(
            w, rows, impulse, self._velocity, self._middle, shift, len(shift) > 0, met, self._options.cone,
            np.empty(data.nefc), np.empty(2 * data.ncon, np.int32), np.empty(data.ncon),
        )  # fmt: skip
        if status != FINE:
            raise DivergenceError(f"position or velocity is not finite, or huge, at t = {data.time - w.timestep:.6g} s")
        return remains

    def _contact(self, w: World, data: mujoco.MjData, free: np.ndarray, left: np.ndarray | None) -> None:
        """Add the effect of contact to the velocity, which is ``free``, (nv,), without it, and go to the end.

        ``left``, (nq,), is where the last step has left data, if it has.
        """
        self.problem.begin()
        working_set = WorkingSet(
            self.model, w, self.problem, self.inertial, self._friction, self._velocity, self._middle,
            _inertia_of(self.model, data, w.damped), self._memory.work, MANY_ROUNDS if self.solved else FEW_ROUNDS,
        )  # fmt: skip
        outcome, farther, work = working_set.find(data, self._known), 0, 1.0
        while outruns := self._outruns(w, data, outcome):
            work, used = working_set.work[0], work - working_set.work[0]
            if farther == WIDER_DETECTIONS or not work - RESERVE > used:  # a further attempt would find worse impulses
                break
            self._overflown = for_python(detect_farther)(w, self._velocity, free, self._middle, self._room)
            outcome, farther = working_set.find(data, outcome.known), farther + 1
        found, rows = outcome.impulses, outcome.rows
        self._collisions = found.collisions if found else ()
        met = outcome.met and not self._overflown
        self.solved = met and not outcome.loses and not outruns
        short = not (self.solved and outcome.rubs)
        if left is not None:
            keys = np.zeros(0, np.int64) if self._known is None else self._known.key
            short |= for_python(begins_overlapping)(w, rows, keys, left)
        self._known = outcome.known if found else None
        if found and not found.collisions:
            self._held = data.qvel - outcome.free
        if found:
            answer, self.shortfall = found.answer, found.answer.missed
            for_python(write_turns)(rows.groups, rows.rates, answer.impulse, answer.reached, answer.sliding)
        self.short_steps += self._end(w, data, outcome, met=met) or short

    def _outruns(self, w: World, data: mujoco.MjData, outcome: Outcome) -> bool:
        """Return whether a collision throws a body farther than contacts were looked for, although there was room."""
        collides = outcome.impulses is not None and len(outcome.impulses.collisions) > 0
        if not collides or self._overflown:
            return False
        mujoco.mj_comVel(self.model, data)
        return for_python(outrun)(w, self._room)

    def _leave(self, data: mujoco.MjData) -> None:
        """Store the state from which the next step would continue, and its frames."""
        self._left, self._frames = (data.qpos.tobytes(), data.qvel.tobytes()), _frames_of(data)


def _update_frames(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Update frames and velocities of bodies to the state."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)


def _frames_of(data: mujoco.MjData) -> tuple[bytes, ...]:
    """Return one field of each stage of `_update_frames`, to notice a state that was loaded without calling it."""
    return data.xipos.tobytes(), data.subtree_com.tobytes(), data.cvel.tobytes()


def _inertia_of(model: mujoco.MjModel, data: mujoco.MjData, damped: bool) -> Inertia:
    """Return the mass matrix of the step."""
    factor = (data.qH, data.qHDiagInv) if damped else (data.qLD, data.qLDiagInv)
    return Inertia(*factor, model.M_rownnz, model.M_rowadr, model.M_colind)
