"""One case: a scene stepped in one way under one law from one start, beside MuJoCo on the same controls."""

from __future__ import annotations

import copy
import gc
import time
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw import Stepper

from . import starts, ways
from .scenes import Scene, load
from .tally import Tally
from .watch import Watch

Row = dict[str, object]
Report = Callable[[Row], None]
FINE = "fine"
CUT = "out of time"
NO_CONTROLS = "no controls"
NOT_LOADED = "not loaded"


@dataclass(frozen=True)
class Case:
    """What is stepped, how, and for how long.

    Attributes:
        scene: which one.
        way: to step it.
        restitution: e of Moreau's law.
        start: "drop" or "random" controls.
        steps: to take.
        seconds: of wall time after which no new step is begun.
        seed: of random controls.
    """

    scene: Scene
    way: ways.Way
    restitution: float
    start: starts.Start
    steps: int
    seconds: float
    seed: int = 0

    def row(self) -> Row:
        """Return the columns that say which case it is."""
        e = np.nan if self.way == "mujoco" else self.restitution
        return {
            "scene": self.scene.name,
            "source": self.scene.source,
            "way": self.way,
            "e": e,
            "start": self.start,
        }


def run(case: Case, report: Report = lambda row: None, begin: Callable[[int], None] = lambda step: None) -> Row:
    """Step a case to its end, or to an exception, and return its row.

    Args:
        case: which one.
        report: told the row so far about once a second.
        begin: told the number of each step before it is taken.
    """
    report(case.row())
    try:
        loaded = load(case.scene)
        data = starts.start(loaded, case.scene.raised)
    except Exception as error:
        return case.row() | {"outcome": f"{NOT_LOADED}: {described(error)}"}
    model = loaded.model
    if case.start == "random" and model.nu == 0:
        return case.row() | {"nv": model.nv, "outcome": NO_CONTROLS}
    watch = Watch(model)
    tally = Tally(case.steps, watch, data)
    try:
        ways.warm_up(case.way, case.restitution)
        ways.rehearse(model, data, case.way, case.restitution)
        ours = None if case.way == "mujoco" else ways.stepper(model, case.way, case.restitution)
    except Exception as error:
        return case.row() | {"nv": model.nv, "steps": 0, "outcome": described(error)}
    run = _Run(case, model, data, ours, tally)
    gc.collect()
    gc.freeze()  # what was loaded is not looked at again while steps are timed
    outcome = run.all(report, begin)
    gc.unfreeze()
    return run.row() | {"outcome": outcome}


class _Run:
    """Two motions side by side, a block of steps of one after a block of the other, so that both caches stay warm."""

    def __init__(self, case: Case, model: mujoco.MjModel, data: mujoco.MjData, ours: Stepper | None, tally: Tally):
        self._case, self._model, self._ours, self._tally = case, model, ours, tally
        self._data, self._bare = data, copy.copy(data)
        blocks = -(-case.steps // starts.HELD)
        self._controls = starts.controls(model, case.start, data.ctrl.copy(), blocks, case.seed)
        self._step = ways.step_of(model, case.way, ours)
        self._since = self._told = time.perf_counter()

    def all(self, report: Report, begin: Callable[[int], None]) -> str:
        """Take all steps and return the outcome."""
        begin(0)
        report(self.row())
        for block, ctrl in enumerate(self._controls):
            first = block * starts.HELD
            numbers = range(first, min(first + starts.HELD, self._case.steps))
            self._data.ctrl[:] = self._bare.ctrl[:] = ctrl
            if self._ours is not None:
                for number in numbers:
                    self._tally.bare[number] = _timed(mujoco.mj_step, self._model, self._bare)
            outcome = self._block(numbers, report, begin)
            self._tally.look(self._data)
            if outcome != FINE:
                return outcome
        return FINE

    def _block(self, numbers: range, report: Report, begin: Callable[[int], None]) -> str:
        for number in numbers:
            now = time.perf_counter()
            if now - self._since > self._case.seconds:
                return CUT
            if now - self._told > 1.0:
                self._told = now
                self._tally.look(self._data)
                report(self.row())
            begin(number)
            before = self._data.qvel.copy()
            try:
                spent = _timed(self._step, self._data)
            except Exception as error:
                return described(error)
            self._tally.add(number, spent, self._data, before, self._shortfall())
            if not np.isfinite(self._data.qpos).all():
                return "position is not finite"
        return FINE

    def _shortfall(self) -> float:
        """Return by how much the last step missed its law; other schemes than time stepping refuse what they miss."""
        return self._ours.shortfall if self._ours is not None and self._case.way == "time-stepping" else np.nan

    def row(self) -> Row:
        """Return what is known so far."""
        kept = {"nv": self._model.nv, "dt": self._model.opt.timestep}
        warned = [int(w.number) for w in self._data.warning]
        kept |= self._tally.row(bare=self._ours is not None)
        bare = self._bare if self._ours is not None else self._data
        kept |= self._tally.heights(self._data, bare, drop=self._case.start == "drop")
        unlocated = np.nan if self._ours is None else self._ours.unlocated
        return self._case.row() | kept | {"unlocated": unlocated, "warnings": sum(warned)}


def _timed(call: Callable[..., object], *arguments: object) -> float:
    """Return the processor time of a call, s."""
    before = time.thread_time_ns()
    call(*arguments)
    return 1e-9 * (time.thread_time_ns() - before)


def described(error: Exception) -> str:
    """Return type and first line of an exception."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0] if lines else ''}"
