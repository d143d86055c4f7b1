"""Time stepping in compiled code and in Python, from the same state: what both leave behind."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw import Law, Stepper
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, raw, recollect
from impactlaw.stepping.time_stepping.compiled.stepping import CompiledStepping
from impactlaw.stepping.time_stepping.compiled.surfaces import last_motion
from impactlaw.stepping.time_stepping.scheme import TimeStepping

DERIVED = (
    "qpos",
    "qvel",
    "qacc",
    "sensordata",
    "efc_force",
    "qfrc_constraint",
    "act",
    "xpos",
    "cvel",
    "qacc_warmstart",
)


def compiled_stepper(model: mujoco.MjModel, law: Law, **options: object) -> Stepper:
    """Return a stepper whose steps are compiled."""
    stepper = Stepper(model, law, scheme="time-stepping", compiled="auto", **options)  # pyright: ignore[reportArgumentType]
    assert isinstance(stepper.stepping, CompiledStepping)
    return stepper


def begin_alike(ours: Stepper, python: Stepper, one: mujoco.MjData, other: mujoco.MjData) -> None:
    """Let the scheme in Python begin where compiled code does: from its state, and from what it remembers."""
    model, compiled, scheme = ours.model, ours.stepping, python.stepping
    assert isinstance(compiled, CompiledStepping)
    assert isinstance(scheme, TimeStepping)
    kind, numbers = mujoco.mjtState.mjSTATE_INTEGRATION, compiled.numbers
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, one, state, kind)
    mujoco.mj_setState(model, other, state, kind)
    if numbers[MEMORY.steps]:
        begin = MEMORY.left + model.nq + model.nv
        gained, motion = numbers[begin : begin + model.nv], last_motion(numbers, model)
        scheme.resume(other, recollect(numbers, raw(numbers)), gained, motion, solved=compiled.solved)


def difference(one: mujoco.MjData, other: mujoco.MjData, *, leave_out: str = "") -> float:
    """Return by how much the two differ, relative to the size of each field."""
    assert one.time == other.time
    pairs = [(getattr(one, name), getattr(other, name)) for name in DERIVED if name != leave_out]
    return max(float(np.abs(a - b).max(initial=0.0)) / max(1.0, float(np.abs(b).max(initial=0.0))) for a, b in pairs)
