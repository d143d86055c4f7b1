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
from impactlaw.stepping.integration import check_input, empty_state, is_huge, restore_state, save_state
from impactlaw.stepping.plan import Plan
from impactlaw.stepping.time_stepping.compiled.end_of_step import begins_overlapping, correct_end, limit_energy
from impactlaw.stepping.time_stepping.compiled.state.world import World
from impactlaw.stepping.time_stepping.contact_impulses import ContactProblem
from impactlaw.stepping.time_stepping.events import CollisionRecord, events_of
from impactlaw.stepping.time_stepping.free_motion import (
    detect_farther,
    frames_of,
    free_step,
    outrun,
    reach,
    take_far_back,
    to_midpoint,
    update_frames,
    update_inertia,
)
from impactlaw.stepping.time_stepping.inertial_forces import InertialForces
from impactlaw.stepping.time_stepping.problem.forces import listed_stage, sense, write_forces
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_turns
from impactlaw.stepping.time_stepping.problem.rows import Known, Rows
from impactlaw.stepping.time_stepping.problem.solution.scaling import RESERVE
from impactlaw.stepping.time_stepping.problem.tiny_gaps import TOUCHING
from impactlaw.stepping.time_stepping.temporary_options import TemporaryOptions
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, MANY_ROUNDS, WIDER_DETECTIONS
from impactlaw.stepping.time_stepping.working_set import Outcome, WorkingSet
from impactlaw.stepping.time_stepping.world import WorldMemory, errors_of_filter

_ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
_ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


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
        self._surfaces = Surfaces(model, plan.pairs.geoms) if plan.surfaces and model.nmocap else None
        self._options = TemporaryOptions(model)
        self._memory = WorldMemory(model)
        self.inertial = InertialForces(model)
        self._listed = listed_stage(model)
        self._state = empty_state(model)
        self._left: tuple[bytes, ...] = ()
        self._frames: tuple[bytes, ...] = ()
        self._known: Known | None = None
        self._collisions: tuple[CollisionRecord, ...] = ()
        self._rows: Rows | None = None
        self._contacts = np.zeros(0, np.int32), np.zeros(0)  # see `end_of_step.copy_contacts`
        self._counted = False
        self._metric = Inertia(*np.zeros((5, 0)))
        self._middle, self._velocity = np.zeros(0), np.zeros(0)
        self._gained = np.zeros(model.nv)  # change of velocity by forces in the last step, without contact
        self._held = np.zeros(model.nv)  # change of velocity by contact in the last step, if nothing collided
        self.shortfall, self.short_steps, self.unlocated = 0.0, 0, 0
        self.solved, self._overflown = True, False

    def set_law(self, law: Law) -> None:
        """Use another law for the collisions of the next steps."""
        self.problem = self.problem.under(law)

    @property
    def carriers(self) -> np.ndarray:
        """The mocap body that carries each geom, see `Surfaces`, int32 (ngeom,)."""
        none = np.full(self.model.ngeom, -1, np.int32)
        return none if self._surfaces is None else self._surfaces.carrier

    def coefficients(self) -> Coefficients:
        """Return a table of the law's coefficients, initially empty."""
        problem = self.problem
        return Coefficients(problem.targets, problem.names, problem.limits, self.model.njnt)

    @property
    def last_motion(self) -> LastMotion | None:
        """Motion of mocap bodies in the last step; None if they move no surfaces."""
        return None if self._surfaces is None else self._surfaces.last_motion

    def move_on(self, motion: LastMotion | None) -> None:
        """Set the motion of mocap bodies in the last step."""
        if self._surfaces is not None and motion is not None:
            self._surfaces.go_on(motion)

    def take_surfaces(self, surfaces: Surfaces) -> None:
        """Continue with these surfaces, moved by mocap bodies, if the scene has any."""
        if self._surfaces is not None:
            self._surfaces = surfaces

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
            update_frames(self.model, data)
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
            0.0 if self._surfaces is None else 1.0 + self._surfaces.meet,
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
            with self._options:
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
        model, h = self.model, self.model.opt.timestep
        self._collisions, self._rows = (), None
        self.shortfall = 0.0
        same = (data.qpos.tobytes(), data.qvel.tobytes()) == self._left
        if not same or frames_of(data) != self._frames:
            update_frames(model, data)
        if not same:
            self._known, self._gained, self._held = None, np.zeros(model.nv), np.zeros(model.nv)
        if self._surfaces is not None:
            self._surfaces.begin(data, h)
        options = self._options
        w = self._memory.world(data, self.settings(), self._surfaces, damped=options.damped)
        now = reach(w, model, data, self._gained, self._memory.sizes)
        self._velocity, start = data.qvel.copy(), data.qpos.copy()
        self._middle, self._overflown = to_midpoint(w, model, data, self._surfaces, options, now)
        self._metric = free_step(w, model, data, options, self.inertial, self._velocity, self._held)
        self._gained, self._held = data.qvel - self._velocity, np.zeros(model.nv)
        take_far_back(w, model, data, self._velocity, self._middle)
        shift, met = None, True
        if data.nefc:
            shift, met = self._contact(w, data, start if same else None)
        else:
            self._known, self.solved, data.ncon = None, self.solved and not self._overflown, 0
            self.short_steps += self._overflown
            data.qacc[:] = (data.qvel - self._velocity) / h
        data.qpos[:] = self._middle
        if model.nsensordata:
            sense(model, data, self._velocity, self._listed)
        mujoco.mj_integratePos(model, data.qpos, data.qvel, 0.5 * h)
        if shift is not None:
            mujoco.mj_integratePos(model, data.qpos, shift, h)
        if is_huge(data):
            raise DivergenceError(f"position or velocity is not finite, or huge, at t = {data.time - h:.6g} s")
        if self._surfaces is not None:
            self._surfaces.end(data)
        update_frames(model, data)
        model.opt.cone = _ELLIPTIC
        if self._rows is not None and met:  # overlaps that are squeezed cannot be opened
            with errors_of_filter():
                remains = for_python(correct_end)(w, self._rows, *self._contacts)
            self.short_steps += remains and not self._counted
        if self.inertial.act and np.count_nonzero(self.inertial.turning):
            for_python(limit_energy)(w, start, self._velocity, self.inertial.turning, self.inertial.gravity)
        self._finish(data)

    def _contact(self, w: World, data: mujoco.MjData, left: np.ndarray | None) -> tuple[np.ndarray | None, bool]:
        """Add the effect of contact to the velocity; ``left``, (nq,), is where the last step has left data, if it has.

        Return the velocity that opens overlaps, if there are any to open, and whether the law is met.
        """
        self.problem.begin()
        working_set = WorkingSet(
            self.model, w, self.problem, self.inertial, self._friction, self._velocity, self._middle,
            self._metric, self._memory.work, MANY_ROUNDS if self.solved else FEW_ROUNDS,
        )  # fmt: skip
        free = data.qvel.copy()
        outcome, farther, work = working_set.find(data, self._known), 0, 1.0
        while outruns := self._outruns(w, data, outcome):
            work, used = working_set.work[0], work - working_set.work[0]
            if farther == WIDER_DETECTIONS or not work - RESERVE > used:  # a further attempt would find worse impulses
                break
            self._overflown = detect_farther(w, self.model, data, self._options, self._velocity, free, self._middle)
            outcome, farther = working_set.find(data, outcome.known), farther + 1
        found, self._rows = outcome.impulses, outcome.rows
        self._collisions = found.collisions if found else ()
        gaps = np.where(data.contact.efc_address >= 0, data.contact.dist, np.inf)
        self._contacts = data.contact.geom.reshape(-1).copy(), gaps
        data.qpos[:] = self._middle  # the integrator has changed it: limits are counted at the midpoint
        impulses = (outcome.rows, found.answer.impulse) if found else None
        write_forces(self.model, data, self._velocity, self._options.cone, impulses)
        met = outcome.met and not self._overflown
        self.solved = met and not outcome.loses and not outruns
        self._counted = not (self.solved and outcome.rubs)
        if left is not None:
            keys = np.zeros(0, np.int64) if self._known is None else self._known.key
            self._counted |= for_python(begins_overlapping)(w, outcome.rows, keys, left)
        self.short_steps += self._counted
        self._known = outcome.known if found else None
        if not found:
            return None, met
        if not found.collisions:
            self._held = data.qvel - outcome.free
        rows, answer = outcome.rows, found.answer
        for_python(write_turns)(rows.groups, rows.rates, answer.impulse, answer.reached, answer.sliding)
        self.shortfall = answer.missed
        return (answer.shift if len(answer.shift) else None), met

    def _outruns(self, w: World, data: mujoco.MjData, outcome: Outcome) -> bool:
        """Return whether a collision throws a body farther than contacts were looked for, although there was room."""
        collides = outcome.impulses is not None and len(outcome.impulses.collisions) > 0
        return collides and not self._overflown and outrun(w, self.model, data)

    def _finish(self, data: mujoco.MjData) -> None:
        """Write the remaining outputs of a step beside the state."""
        if self.model.opt.enableflags & _ENERGY:
            update_inertia(self.model, data)
            mujoco.mj_energyPos(self.model, data)
            mujoco.mj_energyVel(self.model, data)
        data.qacc_warmstart[:] = data.qacc
        self._leave(data)

    def _leave(self, data: mujoco.MjData) -> None:
        """Store the state from which the next step would continue, and its frames."""
        self._left, self._frames = (data.qpos.tobytes(), data.qvel.tobytes()), frames_of(data)
