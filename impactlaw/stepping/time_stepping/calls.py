"""What compiled steps call in Python: laws that have no table, the control callback, and keeping collisions."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.impact import Impact
from impactlaw.solvers.friction.solve import THOROUGH
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.compiled.state.hook import (
    ASK,
    BEGIN,
    CALL,
    CONTROL,
    HOOK,
    KEEP,
    LOST,
    TOGETHER,
)
from impactlaw.stepping.time_stepping.events import CollisionRecord, beside_constraints
from impactlaw.stepping.time_stepping.law_in_scene import LawInScene
from impactlaw.stepping.time_stepping.problem.contact_snapshot import ContactSnapshot, in_order
from impactlaw.stepping.time_stepping.problem.rows import Rows
from impactlaw.stepping.time_stepping.tolerances import LAW_WORK
from impactlaw.stepping.work import Work


class Posed(NamedTuple):
    """A contact problem that a step poses."""

    rows: Rows  # its rows
    target: np.ndarray  # ``gamma^h``, (g,)
    sliding: np.ndarray  # target sliding velocities, (n,)
    guess: np.ndarray  # impulses from which its solution starts, in units of the problem, (n,)
    rounds: int  # rounds of the slower solvers


class Calls:
    """The calls of one world under a law.

    Compiled code calls this object itself, and Python raises errors of the call where compiled code returns to it.

    Attributes:
        hook: see `compiled.state.hook.Hook`, int64.
        collisions: the collisions kept in the last step.
        watch: called with each problem of the steps, if ``hook`` says so.
    """

    def __init__(self, law: LawInScene):
        self._law, self._work = law, Work(law.model.nv, LAW_WORK, rounds=THOROUGH)
        self.hook = np.zeros(len(HOOK), np.int64)
        self.hook[HOOK.function] = id(self)
        self._data: mujoco.MjData | None = None
        self._seen: ContactSnapshot | None = None  # the contacts last shown to the law
        self._together = False  # whether the law couples these, even if they do not influence each other
        self.collisions: list[CollisionRecord] = []
        self.watch: Callable[[Posed], object] | None = None

    def begin(self, data: mujoco.MjData) -> None:
        """Start a step, in which the law may take some work, see `tolerances.LAW_WORK`."""
        self._data, self._seen, self._together, self.collisions = data, None, False, []
        self._work.begin()

    def __call__(self, place: int) -> int:
        """Do what a call asks for, see `compiled.state.hook.Call`; return the reply."""
        data = self._data
        assert data is not None
        call = _Call(place, self._law.model.nv)
        if call[CALL.purpose] == CONTROL:
            mujoco.get_mjcb_control()(self._law.model, data)  # pyright: ignore[reportOptionalCall]
        elif call[CALL.purpose] == BEGIN:
            self.collisions = []
        elif call[CALL.purpose] == ASK:
            self._seen = seen = self._see(data, call)
            self._together, lost = self._ask(seen, call)
            return TOGETHER * self._together + LOST * lost
        elif call[CALL.purpose] == KEEP:
            self.collisions.append(self._record(data, call))
        elif self.watch is not None:
            target, sliding, guess = call.groups(CALL.target), call.rows(CALL.sliding), call.rows(CALL.x)
            self.watch(Posed(call.all_rows(), target.copy(), sliding.copy(), guess.copy(), call[CALL.rounds]))
        return 0

    def _see(self, data: mujoco.MjData, call: _Call) -> ContactSnapshot:
        """Return copies of the contacts in the middle of the step."""
        law, model = self._law, self._law.model
        factor = (data.qH, data.qHDiagInv) if self.hook[HOOK.damped] else (data.qLD, data.qLDiagInv)
        metric = Inertia(*factor, model.M_rownnz, model.M_rowadr, model.M_colind)
        kept = call.groups(CALL.bound, np.bool_).copy()
        return ContactSnapshot.of(model, data, call.all_rows(), kept, law.names, law.limits, metric)

    def _ask(self, seen: ContactSnapshot, call: _Call) -> tuple[bool, bool]:
        """Write the law's targets for colliding contacts, which include closed ones they reach if the law needs these.

        Where a rule with friction finds no impulses, they are those of the law without friction; where that has no
        solution either, contacts come to rest. Return whether the law couples contacts that do not influence each
        other, and whether it has found no impulses.
        """
        law, rows, velocity = self._law.targets, seen.rows, call.velocity(CALL.before)
        target, sliding = call.groups(CALL.target), call.rows(CALL.sliding)
        groups = in_order(rows, call.groups(CALL.collides, np.bool_))
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
                target[groups], sliding[seen.tangential(groups)[0]] = ended
        if lost or not law.rules(asked):
            found = law.of_all(collision(acts, friction=False))
            lost = lost or found is None
            target[groups] = 0.0 if found is None else found
        return law.couples(asked), lost

    def _record(self, data: mujoco.MjData, call: _Call) -> CollisionRecord:
        """Return a record of a collision."""
        law, model, before = self._law, self._law.model, call.velocity(CALL.before).copy()
        seen = self._seen if law.asks and self._seen is not None else self._see(data, call)
        held: Any = (ctypes.c_double * model.nq).from_address(int(self.hook[HOOK.middle]))
        return CollisionRecord(
            seen, call.groups(CALL.collides, np.bool_).copy(), call.rows(CALL.x).copy(),
            data.time - 0.5 * model.opt.timestep, np.array(held), before,
            call.velocity(CALL.velocity) + call.velocity(CALL.change), call.groups(CALL.reached).copy(),
            call.rows(CALL.sliding).copy(), law.exact, call.share, call.created,
            law.on_inadmissible != "allow" and not self._together,
        )  # fmt: skip


class _Call:
    """The arrays of a call."""

    def __init__(self, place: int, nv: int):
        held: Any = (ctypes.c_int64 * len(CALL)).from_address(place)
        self._numbers, self._nv = np.frombuffer(held, np.int64), nv

    def __getitem__(self, place: int) -> int:
        return int(self._numbers[place])

    def _array(self, place: int, shape: tuple[int, ...], kind: type[np.generic]) -> np.ndarray:
        size = math.prod(shape) * np.dtype(kind).itemsize
        held: Any = (ctypes.c_char * size).from_address(self[place])
        return np.frombuffer(held, kind).reshape(shape)

    def groups(self, place: int, kind: type[np.generic] = np.float64) -> np.ndarray:
        """Return an array with a number for each group, (g,)."""
        return self._array(place, (self[CALL.groups],), kind)

    def rows(self, place: int) -> np.ndarray:
        """Return an array with a number for each row, (n,)."""
        return self._array(place, (self[CALL.rows],), np.float64)

    def velocity(self, place: int) -> np.ndarray:
        """Return a velocity, (nv,)."""
        return self._array(place, (self._nv,), np.float64)

    @property
    def share(self) -> float:
        """Share of restitution that is kept."""
        return float(self._numbers.view(np.float64)[CALL.share])

    @property
    def created(self) -> float:
        """Energy that the law would create in the step without scaling, J."""
        return float(self._numbers.view(np.float64)[CALL.created])

    def all_rows(self) -> Rows:
        """Return a copy of the rows."""
        g, n = self[CALL.groups], self[CALL.rows]
        sparse = self._array(CALL.sparse, (3, n), np.int32)
        m = int((sparse[0] + sparse[1]).max(initial=0))  # there may be room for more
        given = (
            (CALL.sparse, (3, n), np.int32), (CALL.colind, (m,), np.int32), (CALL.value, (m,), np.float64),
            (CALL.kinds, (4, g), np.int32), (CALL.key, (g,), np.int64), (CALL.amounts, (2, g), np.float64),
            (CALL.rates, (7, n), np.float64),
        )  # fmt: skip
        return Rows(*(self._array(*each).copy() for each in given))
