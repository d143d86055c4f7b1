"""One case: a scene stepped in one way under one law from one start, beside MuJoCo with the same controls."""

import copy
import gc
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np

from impactlaw import Stepper

from . import starts, ways
from .scenes import Scene, load
from .tally import Tally
from .watch import Watch

Row = dict[str, object]
FINE = "fine"
CUT = "out of time"
NO_CONTROLS = "no controls"
NOT_LOADED = "not loaded"


@dataclass(frozen=True)
class Case:
    """A scene, how it is stepped, and for how long.

    Attributes:
        scene: the scene.
        way: the way to step it.
        restitution: e of Moreau's law.
        start: "drop" or "random" controls.
        steps: number of steps to take.
        seconds: wall time after which no new step is started, s.
    """

    scene: Scene
    way: ways.Way
    restitution: float
    start: starts.Start
    steps: int
    seconds: float

    def row(self) -> Row:
        """Return the columns that identify the case."""
        e = np.nan if self.way == "mujoco" else self.restitution
        return {"scene": self.scene.name, "source": self.scene.source, "way": self.way, "e": e, "start": self.start}


def run(case: Case) -> Row:
    """Step a case to its end, or to an exception, and return its row."""
    try:
        loaded = load(case.scene)
        data = starts.start(loaded, case.scene.raised)
    except Exception as error:
        return case.row() | {"outcome": f"{NOT_LOADED}: {described(error)}"}
    model = loaded.model
    if case.start == "random" and model.nu == 0:
        return case.row() | {"nv": model.nv, "outcome": NO_CONTROLS}
    tally = Tally(case.steps, Watch(model), data)
    try:
        ways.rehearse(model, data, case.way, case.restitution)
        ours = None if case.way == "mujoco" else ways.stepper(model, case.way, case.restitution)
    except Exception as error:
        return case.row() | {"nv": model.nv, "steps": 0, "outcome": described(error)}
    gc.collect()
    gc.freeze()  # the collector skips loaded objects while steps are timed
    outcome = _step(case, model, data, ours, tally)
    gc.unfreeze()
    row = case.row() | {"nv": model.nv, "dt": model.opt.timestep} | tally.row(bare=ours is not None)
    warned = sum(int(w.number) for w in data.warning)
    counted = {"unlocated": np.nan, "counted": np.nan}
    if ours is not None:
        counted = {"unlocated": ours.unlocated, "counted": ours.short_steps}
    return row | counted | {"warnings": warned, "outcome": outcome}


def _step(case: Case, model: mujoco.MjModel, data: mujoco.MjData, ours: Stepper | None, tally: Tally) -> str:
    """Take all steps, alternating blocks of MuJoCo and of ours, so that caches stay warm; return the outcome."""
    bare, since = copy.copy(data), time.perf_counter()
    step = partial(mujoco.mj_step, model) if ours is None else ours.step
    controls = starts.controls(model, case.start, data.ctrl.copy(), -(-case.steps // starts.HELD), 0)
    for block, ctrl in enumerate(controls):
        first = block * starts.HELD
        numbers = range(first, min(first + starts.HELD, case.steps))
        data.ctrl[:] = bare.ctrl[:] = ctrl
        if ours is not None:
            for number in numbers:
                tally.bare[number] = _timed(mujoco.mj_step, model, bare)
        for number in numbers:
            if time.perf_counter() - since > case.seconds:
                return CUT
            before = data.qvel.copy()
            try:
                spent = _timed(step, data)
            except Exception as error:
                return described(error)
            # only time stepping accepts an inexact step; the other schemes refuse it
            missed = ours.shortfall if ours is not None and case.way == "time-stepping" else np.nan
            tally.add(number, spent, data, before, missed)
            if not np.isfinite(data.qpos).all():
                return "position is not finite"
        tally.look(data)
    return FINE


def _timed(call: Callable[..., object], *arguments: object) -> float:
    """Return the processor time of a call, s."""
    before = time.thread_time_ns()
    call(*arguments)
    return 1e-9 * (time.thread_time_ns() - before)


def described(error: Exception) -> str:
    """Return the type and the first line of an exception."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0] if lines else ''}"
