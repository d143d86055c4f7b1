"""The contact problem of a step: targets of the law, impulses, and collisions one after another."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.errors import DivergenceError, InadmissibleImpactError
from impactlaw.laws import Coulomb, Law
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import geom_names
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.tolerances import meter
from impactlaw.solvers.cones import BILATERAL
from impactlaw.solvers.friction.solve import THOROUGH
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.law_targets import LawTargets
from impactlaw.stepping.time_stepping.events import CollisionRecord, beside_constraints
from impactlaw.stepping.time_stepping.problem.contact_snapshot import ContactSnapshot, in_order
from impactlaw.stepping.time_stepping.problem.drifting_equalities import hold_constraints
from impactlaw.stepping.time_stepping.problem.gradient_turns import write_sliding
from impactlaw.stepping.time_stepping.problem.phases import find_later, later_rates, reached_by, some_groups
from impactlaw.stepping.time_stepping.problem.rows import Known, Rows
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import Aims, Method
from impactlaw.stepping.time_stepping.problem.solution.resolve import Resolved, resolve_step
from impactlaw.stepping.time_stepping.problem.solution.scaling import RESERVE
from impactlaw.stepping.time_stepping.problem.targets import aim, close_gaps
from impactlaw.stepping.time_stepping.tolerances import FEW_ROUNDS, LAW_WORK, PHASES, RESOLVED, REST_SPEED, is_met
from impactlaw.stepping.work import Work


@dataclass(frozen=True, eq=False)
class Start:
    """The start of a step."""

    data: mujoco.MjData  # the state in the middle of the step, with current contacts
    velocity: np.ndarray  # velocity at the start of the step, (nv,)
    free: np.ndarray  # velocity without contact, (nv,)
    middle: np.ndarray  # configuration in the middle of the step, (nq,)
    metric: Inertia  # the inertia of the step
    left: np.ndarray  # remaining part of the work allowed in the step, (1,), see `solvers.cones.budget.spend`


@dataclass(frozen=True, eq=False)
class StepImpulses:
    """The effect of contact in a step."""

    answer: Resolved  # sums and largest values of all phases; ``reached`` is NaN if collisions were one after another
    velocity: np.ndarray  # velocity with these impulses, (nv,)
    collisions: tuple[CollisionRecord, ...]  # collisions of the step, one after another
    # whether restitution is lost: contacts that are hit only through others got no phase of their own, bodies jam, the
    # law found no impulses, or no work was left to find how much restitution creates no energy
    later: bool


@dataclass(frozen=True, eq=False)
class _Phase:
    """Simultaneous collisions: the rows, their targets, and the answer of `resolve_step`."""

    rows: Rows  # rows that take part
    place: np.ndarray  # index of each row that takes part among the given rows, int (n,)
    later: np.ndarray  # given groups that are left out because they are hit only through others, bool (g,)
    cut: bool  # whether some such contacts are not left out
    scalable: bool  # whether restitution creates energy, which must be scaled away or raised as an error
    collides: np.ndarray  # groups that collide
    seen: ContactSnapshot | None  # the contacts shown to the law, if it was asked
    together: bool  # whether the law couples contacts that do not influence each other
    lost: bool  # whether the law, or its friction, has found no impulses
    answer: Resolved

    @property
    def solved(self) -> bool:
        """Whether the law is met."""
        return is_met(self.answer.missed, self.answer.fastest)


class ContactProblem:
    """Finds the impulses of a step under one law; see `scheme.TimeStepping`.

    Attributes:
        law: the law.
        targets: the contact velocities that the law aims at.
        bilateral: kinds of equality constraints, 0 where collisions may violate them, uint8 (neq,).
        names: names of geoms, as in labels of contacts.
        limits: the limits of joints and tendons.
        meter: see `scene.tolerances.meter`.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        law: Law,
        *,
        friction: Literal["coulomb", "convex", "ignore"],
        on_inadmissible: Literal["raise", "project", "allow"],
        rest_speed: float | None,
    ):
        self._model, self._exact_cones, self._on_inadmissible = model, friction != "convex", on_inadmissible
        self._rest_speed = REST_SPEED if rest_speed is None else rest_speed
        self.meter = meter(model.opt.gravity)
        self.bilateral, self.names, self.limits = constraint_kinds(model), geom_names(model), Limits(model)
        self._work = Work(model.nv, LAW_WORK, rounds=THOROUGH)
        self._take(law)

    def begin(self) -> None:
        """Start a step, in which the law may take some work, see `tolerances.LAW_WORK`."""
        self._work.begin()

    def under(self, law: Law) -> ContactProblem:
        """Return the same problem under another law."""
        other = copy.copy(self)
        other._take(law)
        return other

    def _take(self, law: Law) -> None:
        self.law, self.targets = law, LawTargets(law, exact=self._exact_cones)
        self._sliding = law.tangential_restitution if isinstance(law, Coulomb) else 0.0
        self._exact = law.cone == "exact" if isinstance(law, Coulomb) else self._exact_cones

    def settings(self) -> tuple[float, float, float, float]:
        """Return the options in the form of compiled code, see `compiled.state.world.Settings`."""
        dissipative = {"project": 1.0, "allow": 0.0, "raise": -1.0}[self._on_inadmissible]
        return self._rest_speed, self._sliding, float(self._exact), dissipative

    def inadmissible(self, created: float, time: float) -> InadmissibleImpactError:
        """Return the error of a step in which the law creates some energy, J."""
        return InadmissibleImpactError(
            f"{self.law!r} creates {created:.3g} J at t = {time:.6g} s; choose a dissipative law, or "
            'on_inadmissible="project" or "allow"'
        )

    def find(self, step: Start, rows: Rows, known: Known | None, rounds: int, *, phases: bool) -> StepImpulses:
        """Return the impulses and velocities of the contacts in a step.

        With phases, contacts that are hit only through others, across an open gap, are left out first, and collide
        starting from the velocity after the collision of the others. There are at most `PHASES` phases, as long as more
        work than `RESERVE` is left, and no phase follows one whose problem was not solved. In the last phase such a
        contact is merely kept from penetrating. Restitution is scaled so that it creates no energy only when no contact
        is left out any more: the reserved work is for that.

        Args:
            step: the start of the step.
            rows: the rows that take part.
            known: impulses of the last step, as initial guess.
            rounds: rounds of the slower solvers.
            phases: whether contacts may collide one after another.

        Raises:
            DivergenceError: the forces are not finite.
            InadmissibleImpactError: the law creates energy, and ``on_inadmissible`` is "raise".
        """
        known = known or rows.known(np.zeros(len(rows.scale)))
        now, place, may = rows, np.arange(len(rows.scale)), np.ones(len(rows.key), dtype=bool)
        impulse, before, after = np.zeros(len(rows.scale)), step.velocity, step.free
        missed = fastest = work = rounding = residual = 0.0
        records: tuple[CollisionRecord, ...] = ()
        cut, more, answer = False, phases, None
        for phase in range(PHASES):
            met = self._meet(step, now, before, known, rounds, may, more=more and phase < PHASES - 1)
            answer, more = met.answer, more and met.solved
            # bodies jam, no work was left to find how much restitution creates no energy, or the law has no solution
            gives_up = answer.share == 0.0 or answer.created > 0.0 >= step.left[0] or met.lost
            cut = bool(cut or met.cut or gives_up)
            impulse[place[met.place]] += answer.impulse
            after = after + answer.change
            missed, fastest = max(missed, answer.missed), max(fastest, answer.fastest)
            residual = max(residual, answer.residual)
            work, rounding = work + answer.work, rounding + answer.rounding
            if np.count_nonzero(met.collides):
                records += (self._record(step, met, before, after),)
            if not np.count_nonzero(met.later):
                break
            keep = for_python(reached_by)(now, self._model.dof_treeid, met.later)
            now, where = for_python(some_groups)(now._replace(rates=for_python(later_rates)(now, answer.jump)), keep)
            place, may, rounds = place[where], met.later[keep], FEW_ROUNDS
            before = step.velocity + (after - step.free)
        assert answer is not None
        answer = answer._replace(
            impulse=impulse, missed=missed, fastest=fastest, work=work, rounding=rounding, residual=residual,
            reached=np.full(len(rows.key), np.nan) if phases else answer.reached,
        )  # fmt: skip
        return StepImpulses(answer, after, records, cut)

    def _meet(
        self, step: Start, rows: Rows, before: np.ndarray, known: Known, rounds: int, may: np.ndarray, *, more: bool
    ) -> _Phase:
        """Solve one phase; if there may be `more`, solve it again without contacts that are hit only through others."""
        part, place, later = rows, np.arange(len(rows.scale)), np.zeros(len(may), dtype=bool)
        while True:
            keep = np.flatnonzero(~later)
            met = self._solve(step, part, before, known, rounds, may[keep], scaled=False)
            new = self._later(met)
            cut = bool(np.count_nonzero(new))
            if not cut or not more or not met.solved or step.left[0] <= RESERVE:
                break
            later[keep] |= new
            known, rounds = met.rows.known(met.answer.impulse), FEW_ROUNDS
            part, place = for_python(some_groups)(rows, ~later)
        if met.scalable:
            met = self._solve(step, part, before, known, rounds, may[keep], scaled=True)
        return replace(met, place=place, later=later, cut=cut)

    def _later(self, met: _Phase) -> np.ndarray:
        """Return which contacts are hit only through the collision of others, bool (g,)."""
        later = np.zeros_like(met.collides)
        if np.count_nonzero(met.collides) and self.targets.restitution != 0.0:
            jump, impulse = met.answer.jump, met.answer.impulse
            for_python(find_later)(
                met.rows, jump, impulse, met.collides, self._rest_speed, RESOLVED * self.meter, later
            )
        return later

    def _solve(
        self, step: Start, rows: Rows, before: np.ndarray, known: Known, rounds: int, may: np.ndarray, *, scaled: bool
    ) -> _Phase:
        """Solve the problem of these rows; see `find`.

        If restitution is to be `scaled`, it creates no energy, or an error is raised.
        """
        model, h = self._model, self._model.opt.timestep
        e, n, g, seen = self.targets.restitution or 0.0, len(rows.scale), len(rows.key), None
        together = lost = False
        target, collides, bound = np.empty(g), np.empty(g, dtype=bool), np.zeros(g, dtype=bool)
        resolved = RESOLVED * self.meter
        some = for_python(aim)(
            rows.groups, rows.key, rows.amounts, rows.rates, h, e, self._rest_speed, resolved, may, target, collides
        )
        aims = Aims(target, -self._sliding * rows.before if self._sliding and some else np.zeros(n), collides)
        if some:
            seen, together, lost = self._collide(step, rows, before, aims, bound)
        else:
            for_python(write_sliding)(rows.groups, rows.rates, resolved, aims.sliding)
        project = scaled and self._on_inadmissible == "project"
        answer = resolve_step(
            rows, aims, bound, known, h, project, together,
            Method(model.dof_treeid, self._exact, rounds, step.left), step.metric,
        )  # fmt: skip
        created = answer.created
        if not np.isfinite(answer.missed):
            raise DivergenceError(f"the forces at t = {step.data.time - h:.6g} s are not finite")
        if scaled and created > 0.0 and self._on_inadmissible == "raise":
            raise self.inadmissible(created, step.data.time - h)
        none = np.zeros(len(rows.key), dtype=bool)
        scalable = created > 0.0 and self._on_inadmissible != "allow"
        return _Phase(rows, np.arange(n), none, False, scalable, collides, seen, together, lost, answer)

    def _collide(
        self, step: Start, rows: Rows, before: np.ndarray, aims: Aims, bound: np.ndarray
    ) -> tuple[ContactSnapshot | None, bool, bool]:
        """Get the targets of the law, and make equality constraints keep their velocity in the collision.

        Write which constraints must not drive the collision. Return the contacts shown to the law, and what `_ask_law`
        returns.
        """
        data, collides, seen = step.data, aims.collides, None
        together = lost = False
        if self.targets.restitution is None:
            seen = self._see(step, rows)
            if not self.targets.alone:
                collides |= seen.reached(collides, np.zeros(len(collides), dtype=bool))
        if data.ne:
            kinds = self._kinds(data, rows)
            for_python(hold_constraints)(rows, collides, kinds, self._model.dof_treeid)
            bound[:] = kinds != 0
        if seen is not None:
            together, lost = self._ask_law(seen, before, aims)
        for_python(close_gaps)(rows, self._model.dof_treeid, collides, aims.target)
        return seen, together, lost

    def _kinds(self, data: mujoco.MjData, rows: Rows) -> np.ndarray:
        """Return `constraint_kinds` for groups that are equality constraints, 0 for other groups, uint8 (g,)."""
        kinds, equal = np.zeros(len(rows.key), dtype=np.uint8), rows.kind == BILATERAL
        kinds[equal] = self.bilateral[data.efc_id[rows.row[rows.first[equal]]]]
        return kinds

    def _see(self, step: Start, rows: Rows) -> ContactSnapshot:
        kept = self._kinds(step.data, rows) != 0
        return ContactSnapshot.of(self._model, step.data, rows, kept, self.names, self.limits, step.metric)

    def _ask_law(self, seen: ContactSnapshot, velocity: np.ndarray, aims: Aims) -> tuple[bool, bool]:
        """Write the law's targets for colliding contacts, which include closed ones they reach if the law needs these.

        Where a rule with friction finds no impulses, they are those of the law without friction; where that has no
        solution either, contacts come to rest. Return whether the law couples contacts that do not influence each
        other, and whether it has found no impulses.
        """
        law, rows, target = self.targets, seen.rows, aims.target
        groups = in_order(rows, aims.collides)
        labels = seen.contacts(groups).labels
        if law.alone:
            target[groups] = law.of_each(labels, rows.before[rows.first[groups]])
            return False, False

        def collision(acts: np.ndarray, *, friction: bool) -> Collision:
            return seen.collision(groups, velocity, labels, friction=friction, acts=acts)

        def resolve(acts: np.ndarray) -> tuple[Impact, bool | None]:
            c = collision(acts, friction=law.rule is not None)
            impact = law.outcome(c, self._work)
            return (Impact.observed(c, c.pre_velocity), True) if impact is None else (impact, None)

        acts = beside_constraints(seen, groups, resolve)[1] if seen.kept.any() else seen.kept
        asked, lost = collision(acts, friction=law.rule is not None), False
        if law.rules(asked):
            ended = law.with_friction(asked, self._work)
            lost = ended is None
            if ended is not None:
                target[groups], aims.sliding[seen.tangential(groups)[0]] = ended
        if lost or not law.rules(asked):
            found = law.of_all(collision(acts, friction=False))
            lost = lost or found is None
            target[groups] = 0.0 if found is None else found
        return law.couples(asked), lost

    def _record(self, step: Start, met: _Phase, before: np.ndarray, after: np.ndarray) -> CollisionRecord:
        """Return a record of a collision."""
        answer = met.answer
        seen = met.seen or self._see(step, met.rows)
        by_islands = self._on_inadmissible != "allow" and not met.together
        return CollisionRecord(
            seen, met.collides, answer.impulse, step.data.time - 0.5 * self._model.opt.timestep, step.middle, before,
            after.copy(), answer.reached, answer.sliding, self._exact, answer.share, by_islands,
        )  # fmt: skip
