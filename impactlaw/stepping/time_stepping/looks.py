"""The looks at contacts of one step: the problem is solved again while its velocity closes contacts left out of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from impactlaw.stepping.time_stepping.contact_impulses import ContactProblem
from impactlaw.stepping.time_stepping.events import Known, Metric, StepImpulses
from impactlaw.stepping.time_stepping.inertial_forces import ROUNDS, InertialForces
from impactlaw.stepping.time_stepping.problem.reader import RowReader
from impactlaw.stepping.time_stepping.problem.rows import Rows
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, LOOKS, PHASE_LOOK_ROWS, PHASE_LOOKS, is_met


@dataclass(frozen=True, eq=False)
class Look:
    """What one look has found.

    Attributes:
        rows: that take part; may be none.
        impulses: what contact does; None without rows.
        known: impulses, a guess for the next look or step.
    """

    rows: Rows
    impulses: StepImpulses | None
    known: Known | None

    @property
    def loses(self) -> bool:
        """Whether contacts lose their restitution, see `StepImpulses.later`."""
        return self.impulses is not None and self.impulses.later

    @property
    def met(self) -> bool:
        """Whether the law is met."""
        return self.impulses is None or is_met(self.impulses.shortfall, self.impulses.fastest)


@dataclass(frozen=True, eq=False)
class Looks:
    """Finds what contact does in one step.

    Attributes:
        model: the scene.
        problem: of contact, under the law.
        reader: of rows.
        inertial: Coriolis and gyroscopic forces.
        velocity: at the start of the step, (nv,).
        middle: configuration in the middle of the step, (nq,).
        metric: the inertia of the step.
        work: part of the work allowed in the step that is left, (1,), see `solvers.cones.hybrid.spend`.
        rounds: of the slower solvers.
        phases: whether collisions may be one after another.
    """

    model: mujoco.MjModel
    problem: ContactProblem
    reader: RowReader
    inertial: InertialForces
    velocity: np.ndarray
    middle: np.ndarray
    metric: Metric
    work: np.ndarray
    rounds: int
    phases: bool = False

    def find(self, data: mujoco.MjData, known: Known | None) -> Look:
        """Add what contact does to the velocity of data, and return what the last look has found.

        Contacts that are far from closing are left out. If the velocity found would close one of them, it takes part.
        Where contacts are hit only through others, these collide first, which may close further ones.
        A collision changes the mean velocity, in which Coriolis and gyroscopic forces do no work: where they have done
        more than contact has taken, they are corrected.

        Args:
            data: in the middle of the step, contacts current, its velocity the one without contact.
            known: impulses of the step before.
        """
        free, h = data.qvel.copy(), self.model.opt.timestep
        near, look = self.reader.near(data, self.velocity, free, 2.0 * h), 1
        found, looks = self._try(data, near, free, known), replace(self, rounds=FEW_ROUNDS)
        while look < LOOKS + PHASE_LOOKS:
            new = self.reader.near(data, data.qvel, data.qvel, h) & ~near
            many = len(found.rows.row)
            if np.count_nonzero(new) and (many <= PHASE_LOOK_ROWS if looks.phases else look < LOOKS):
                near = near | new
            elif found.loses and found.met and not looks.phases and self.work[0] > 0.0:
                looks = replace(looks, phases=True)
            else:
                break
            look += 1
            found = looks._try(data, near, free, found.known)
        return looks._lose_energy(data, near, free, found, look)

    def _lose_energy(self, data: mujoco.MjData, near: np.ndarray, free: np.ndarray, found: Look, look: int) -> Look:
        """Let inertial forces be those of the mean velocity while a collision creates energy with them."""
        created = self._created(data, found)
        while look < LOOKS + PHASE_LOOKS + ROUNDS and found.impulses and created > found.impulses.rounding:
            before, mean, look = (free, created), 0.5 * (self.velocity + data.qvel), look + 1
            free = self.inertial.lead_to(data, self.velocity, mean, self.metric, self.model.opt.timestep)
            found = self._try(data, near, free, found.known)
            created = self._created(data, found)
            if not created < 0.5 * before[1]:  # they turn too fast for that
                if created > before[1]:
                    found = self._try(data, near, before[0], found.known)
                break
        return found

    def _try(self, data: mujoco.MjData, near: np.ndarray, free: np.ndarray, known: Known | None) -> Look:
        """Solve the problem of the rows that are near."""
        rows = self.reader.read(data, near, self.velocity, free, self.metric)
        if not len(rows.key):
            return Look(rows, None, known)
        found = self.problem.find(
            data, rows, self.velocity, free, self.middle, self.metric, known, self.rounds, self.work,
            phases=self.phases,
        )  # fmt: skip
        data.qvel[:] = found.velocity
        return Look(rows, found, (rows.groups, rows.key, rows.scale, found.impulse))

    def _created(self, data: mujoco.MjData, look: Look) -> float:
        """Return the work of contact in a collision and of Coriolis and gyroscopic forces, J; 0 where there is none.

        Where nothing is to be lost either, its size.
        """
        found = look.impulses
        if found is None or not found.collisions or not self.inertial.act:
            return 0.0
        work = found.work + self.inertial.work(self.velocity, data.qvel, self.model.opt.timestep)
        return abs(work) if self.problem.targets.restitution == 1.0 else work
