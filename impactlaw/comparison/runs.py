"""Simulation of a scene under an impact law or under MuJoCo's soft contacts, and its results."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from impactlaw.comparison.soft_collisions import SoftCollisions
from impactlaw.comparison.soft_contact import deepest_gap, soft_outcome
from impactlaw.errors import DivergenceError, InadmissibleImpactError, RestitutionError, SolverError, UnsolvableLawError
from impactlaw.laws import Law
from impactlaw.mechanics.impact import Impact
from impactlaw.recording import Recorder
from impactlaw.recording.properties import law_name
from impactlaw.scene.detection import Detector
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.integration import restore_state, save_state
from impactlaw.stepping.stepper import Stepper


@dataclass(frozen=True, eq=False)
class Run:
    """The results of one simulation of the scene."""

    name: str  # name of the law, or of MuJoCo's contacts
    times: np.ndarray  # s, (n + 1,), at the start and after every step
    velocities: np.ndarray  # qvel, (n + 1, nv)
    kinetic: np.ndarray  # energy, J, (n + 1,)
    potential: np.ndarray  # energy, J, (n + 1,)
    deepest: float  # smallest gap seen after any step, 0 if none overlapped, m
    events: int | None  # number of collisions resolved; None for soft contacts
    unlocated: int  # number of steps with too many collisions to locate one by one
    seconds_per_step: float  # mean wall time of a step, without the slowest one
    first: Impact | None  # outcome of the first collision; None if there was no collision
    qpos: np.ndarray | None  # configuration of the first collision, (nq,); None for soft contacts
    refusal: str = ""  # why the run ended early, or an empty string
    law: str | None = None  # the law in one line; None for soft contacts


_ENDS = InadmissibleImpactError, UnsolvableLawError, RestitutionError, SolverError, DivergenceError
_BAD = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{name}")) for name in ("QPOS", "QVEL", "QACC")]


class _Trajectory:
    """The states, energies and times of steps that a run collects."""

    def __init__(self, model: mujoco.MjModel):
        self._model, self._detector = model, Detector(model)
        self._states: list[tuple[Any, ...]] = []
        self._deepest = 0.0
        self.spent: list[float] = []

    def add(self, data: mujoco.MjData) -> None:
        self._deepest = min(self._deepest, deepest_gap(self._model, data, self._detector))
        mujoco.mj_energyPos(self._model, data)
        mujoco.mj_energyVel(self._model, data)
        potential, kinetic = data.energy
        self._states.append((data.time, data.qvel.copy(), kinetic, potential))

    def run(self, name: str, **more: Any) -> Run:
        """Return the results, with the mean time of a step without the slowest, which may have loaded compiled code."""
        arrays, spent = map(np.array, zip(*self._states, strict=True)), self.spent
        mean = (sum(spent) - max(spent)) / (len(spent) - 1) if len(spent) > 1 else sum(spent)
        return Run(name, *arrays, deepest=self._deepest, seconds_per_step=mean, **more)


def run_law(
    model: mujoco.MjModel,
    start: mujoco.MjData,
    name: str,
    law: Law,
    steps: int,
    *,
    options: Mapping[str, Any] | None = None,
    recorder: Recorder | None = None,
    progress: Callable[[], object] = lambda: None,
) -> Run:
    """Simulate the scene rigidly under a law; a collision that the law cannot resolve ends the run with the reason."""
    data = _copy(model, start)
    stepper = Stepper(model, law, **(options or {}))
    trajectory = _Trajectory(model)
    trajectory.add(data)
    if recorder is not None:
        recorder.step(data)
    first: ImpactEvent | None = None
    events, refusal = 0, ""
    for _ in range(steps):
        begin = time.perf_counter()
        try:
            stepper.step(data)
        except _ENDS as error:
            refusal = str(error)
            break
        trajectory.spent.append(time.perf_counter() - begin)
        if first is None and stepper.events:
            first = stepper.events[0]
        events += len(stepper.events)
        trajectory.add(data)
        if recorder is not None:
            recorder.step(data, stepper.events)
        progress()
    impact, qpos = (None, None) if first is None else (first.impact, first.qpos)
    told = {"events": events, "unlocated": stepper.unlocated, "refusal": refusal, "law": law_name(law)}
    return trajectory.run(name, first=impact, qpos=qpos, **told)


def run_soft(
    model: mujoco.MjModel,
    start: mujoco.MjData,
    name: str,
    steps: int,
    reference: Run | None,
    *,
    recorder: Recorder,
    progress: Callable[[], object],
) -> Run:
    """Simulate the scene with MuJoCo's contacts, and audit their outcome of the first collision of the reference run.

    The recording has the collisions of this run itself, see `SoftCollisions`. The run ends when MuJoCo finds numbers
    that are not finite, since MuJoCo would continue from the initial state of the scene.
    """
    data, seen, refusal = _copy(model, start), _copy(model, start), ""
    trajectory, collisions = _Trajectory(model), SoftCollisions(model)
    trajectory.add(seen)
    collisions.look(seen)
    recorder.step(seen)
    for _ in range(steps):
        begin = time.perf_counter()
        mujoco.mj_step(model, data)
        if data.warning.number[_BAD].any():
            refusal = "MuJoCo's simulation left the finite numbers; take a shorter timestep"
            break
        trajectory.spent.append(time.perf_counter() - begin)
        _assign(model, data, seen)  # reading contacts must not disturb the solver
        trajectory.add(seen)
        recorder.step(seen, collisions.look(seen))
        progress()
    first = None
    if reference is not None and reference.first is not None:
        _assign(model, start, data)
        data.qpos[:] = reference.qpos
        first = soft_outcome(model, data, reference.first)
    return trajectory.run(name, events=None, unlocated=0, first=first, qpos=None, refusal=refusal)


def _copy(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    copied = mujoco.MjData(model)
    _assign(model, data, copied)
    return copied


def _assign(model: mujoco.MjModel, source: mujoco.MjData, target: mujoco.MjData) -> None:
    restore_state(model, target, save_state(model, source))
