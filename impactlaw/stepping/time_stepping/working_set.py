"""Find the impulses of a step by a working set of contacts; it grows by those that the resulting velocity closes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.stepping.compiled.dense import sparse_jacobian
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.compiled.impulses.forces import created as created_by
from impactlaw.stepping.time_stepping.compiled.impulses.forces import forces_at, half, split, stale
from impactlaw.stepping.time_stepping.compiled.impulses.rows import choose, look, rows_of
from impactlaw.stepping.time_stepping.compiled.state.world import World
from impactlaw.stepping.time_stepping.contact_impulses import ContactProblem, Start, StepImpulses
from impactlaw.stepping.time_stepping.inertial_forces import ROUNDS, SMALL_PART, InertialForces
from impactlaw.stepping.time_stepping.problem.energy import add_before
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_recalled
from impactlaw.stepping.time_stepping.problem.rows import Known, Rows
from impactlaw.stepping.time_stepping.problem.targets import write_closing
from impactlaw.stepping.time_stepping.tolerances import (
    FEW_ROUNDS,
    PHASE_SET_ROWS,
    PHASE_SETS,
    SETS,
    SHORTFALL_LIMIT,
    is_met,
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of the problem of one working set."""

    rows: Rows  # rows that take part, possibly none
    impulses: StepImpulses | None  # impulses and velocities of contact; None without rows
    known: Known | None  # impulses, a guess for the next working set or step
    free: np.ndarray  # velocity without contact, (nv,), with the inertial forces that were used
    unseen: bool = False  # whether contacts are left out that the resulting velocity would close

    @property
    def loses(self) -> bool:
        """Whether contacts lose their restitution, see `StepImpulses.later`, or are left out."""
        return self.unseen or (self.impulses is not None and self.impulses.later)

    @property
    def collided(self) -> np.ndarray | None:
        """Groups that have collided, bool (g,), in the first of several collisions; None if none has."""
        collisions = self.impulses.collisions if self.impulses else ()
        return collisions[0].collides if collisions else None

    @property
    def met(self) -> bool:
        """Whether the law is met in the normal directions."""
        return self.impulses is None or is_met(self.impulses.answer.missed, self.impulses.answer.fastest)

    @property
    def rubs(self) -> bool:
        """Whether friction is met, too."""
        return self.impulses is None or self.impulses.answer.residual <= SHORTFALL_LIMIT


@dataclass(frozen=True, eq=False)
class WorkingSet:
    """Finds the effect of contact in one step."""

    model: mujoco.MjModel  # the scene
    world: World  # the same with its data, for functions of compiled steps
    problem: ContactProblem  # the contact problem under the law
    inertial: InertialForces  # Coriolis and gyroscopic forces
    frictional: bool  # whether contacts have friction
    velocity: np.ndarray  # velocity at the start of the step, (nv,)
    middle: np.ndarray  # configuration in the middle of the step, (nq,)
    metric: Inertia  # the inertia of the step
    work: np.ndarray  # remaining part of the work allowed in the step, (1,), see `solvers.cones.budget.spend`
    rounds: int  # rounds of the slower solvers
    phases: bool = False  # whether contacts may collide one after another
    moved: np.ndarray | None = None  # added to the velocity before a collision, (nv,), see `inertial_forces`

    def find(self, data: mujoco.MjData, known: Known | None) -> Outcome:
        """Add the effect of contact to the velocity of data, and return the result of the last working set.

        Contacts that are far from closing are left out, and those that bodies may pass over, see `passed_edges`. If the
        resulting velocity would close one of them, it joins the next working set. If contacts are hit only through
        others, the others collide first, which may close further contacts. The same is tried if a few sets do not hold
        everything that closes. If Coriolis and gyroscopic forces create energy because of a collision, the collision is
        put between two half steps.
        """
        free, begun, sets, jacobian = data.qvel.copy(), self.work[0], 1, sparse_jacobian(self.model, data)
        (near, new), doubtful = np.empty((2, data.nefc), dtype=bool), np.zeros(data.ncon, dtype=bool)
        doubts = for_python(choose)(self.world, jacobian, self.velocity, free, self.middle, near, new, doubtful)
        found, current = self._try(data, near, free, known), replace(self, rounds=FEW_ROUNDS)
        while True:
            for_python(look)(self.world, jacobian, self.middle, doubts, near, new, doubtful)
            more, unseen = sets < SETS + PHASE_SETS, bool(np.count_nonzero(new & ~near))
            allowed = len(found.rows.row) <= PHASE_SET_ROWS if current.phases else sets < SETS
            if more and unseen and allowed:
                near = near | new
            elif more and (unseen or found.loses) and found.met and not current.phases and 2.0 * self.work[0] > begun:
                near, current = near | new, replace(current, phases=True)
            else:
                break
            sets += 1
            found = current._try(data, near, free, found.known)
        return replace(current._lose_energy(data, near, free, found), unseen=unseen)

    def _lose_energy(self, data: mujoco.MjData, near: np.ndarray, free: np.ndarray, found: Outcome) -> Outcome:
        """Put a collision between two half steps if it creates energy together with inertial forces."""
        w, forces, v, nv = self.world, self.inertial, self.velocity, self.world.nv
        if found.impulses is None or not found.impulses.collisions or not forces.act:
            return found
        begin, end, used, mean, last, moved = np.zeros((6, nv))
        own = for_python(created_by)(w, v, forces.used, mean)
        created = self._size(found.impulses.answer.work + own, found.rows)
        if not created > found.impulses.answer.rounding or self._size(own, found.rows) < SMALL_PART * created:
            return found
        best, was, gravity, rates = (self, free, created), np.inf, forces.gravity, (forces.turning, mean, last)
        for_python(forces_at)(w, np.zeros(nv), gravity)
        begins = for_python(half)(w, v, gravity, -w.timestep, *rates, begin)
        ends = for_python(half)(w, data.qvel, gravity, w.timestep, *rates, end)
        for _ in range(ROUNDS if begins and ends else 0):
            used[:], free = end, np.empty(nv)
            for_python(split)(w, v, gravity, begin, end, mean, moved, free)
            current = replace(self, moved=moved.copy())
            found = current._try(data, near, free, found.known, found.collided)
            for_python(half)(w, data.qvel, gravity, w.timestep, *rates, end)
            answer = found.impulses.answer if found.impulses else None
            work, rounding = (answer.work, answer.rounding) if answer else (0.0, 0.0)
            created = self._size(work + for_python(stale)(w, data.qvel, end, used, mean), found.rows)
            if created < best[2]:
                best = current, free, created
            if not rounding < created < 0.5 * was:
                break
            was = created
        if not created <= best[2]:
            found = best[0]._try(data, near, best[1], found.known, found.collided)
        return found

    def _size(self, work: float, rows: Rows) -> float:
        """Return the energy that a collision creates; its absolute value if energy must not be lost, either."""
        slides = self.frictional and len(rows.scale) > len(rows.key)
        return abs(work) if self.problem.targets.restitution == 1.0 and not slides else work

    def _try(
        self,
        data: mujoco.MjData,
        near: np.ndarray,
        free: np.ndarray,
        known: Known | None,
        collided: np.ndarray | None = None,
    ) -> Outcome:
        """Solve the problem of the rows that are near; between half steps, the same contacts collide as before."""
        jacobian = sparse_jacobian(self.model, data)
        rows = for_python(rows_of)(self.world, jacobian, near, self.velocity, free)
        if not len(rows.key):
            return Outcome(rows, None, known, free)
        if known is not None:
            for_python(write_recalled)(rows.groups, rows.key, rows.rates, known.groups, known.key, known.turns)
        before = self.velocity
        if self.moved is not None:
            before = before + self.moved
            for_python(add_before)(rows.sparse, rows.rates, jacobian, self.moved)
            if collided is not None and not self.phases:
                for_python(write_closing)(rows.groups, rows.amounts, rows.rates, self.model.opt.timestep, collided)
        step = Start(data, before, free, self.middle, self.metric, self.work)
        found = self.problem.find(step, rows, known, self.rounds, phases=self.phases)
        data.qvel[:] = found.velocity
        return Outcome(rows, found, rows.known(found.answer.impulse), free)
