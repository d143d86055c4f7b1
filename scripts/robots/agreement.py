"""Do steps in compiled code and in Python agree, from the same state, on the scenes of this study?

``python -m scripts.robots.agreement``: each scene is stepped under random controls in compiled code. Every step is
repeated by the scheme in Python, from the same state and memory. Differences are relative to the size of each field.
"""

import time
import warnings
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from tqdm import tqdm

from impactlaw import Law, Moreau, Stepper
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, raw, recollect
from impactlaw.stepping.time_stepping.compiled.state.surfaces import last_motion
from impactlaw.stepping.time_stepping.compiled.stepping import CompiledStepping
from impactlaw.stepping.time_stepping.scheme import TimeStepping
from scripts.options import Count, Seconds, read

from . import scenes
from .starts import HELD, controls, start

CLOSE = 1e-10
"""Largest difference that counts as rounding."""

_LAW = Moreau(0.5)
DERIVED = ("qpos", "qvel", "qacc", "sensordata", "qfrc_constraint", "act", "xpos", "cvel", "qacc_warmstart")


def compiled_stepper(model: mujoco.MjModel, law: Law, **options: object) -> Stepper:
    """Return a stepper with compiled time steps."""
    stepper = Stepper(model, law, scheme="time-stepping", compiled="auto", **options)  # pyright: ignore[reportArgumentType]
    assert isinstance(stepper.stepping, CompiledStepping)
    return stepper


def begin_alike(ours: Stepper, python: Stepper, one: mujoco.MjData, other: mujoco.MjData) -> None:
    """Give the scheme in Python the state and the memory that the next compiled step starts from."""
    model, compiled, scheme = ours.model, ours.stepping, python.stepping
    assert isinstance(compiled, CompiledStepping)
    assert isinstance(scheme, TimeStepping)
    kind, numbers = mujoco.mjtState.mjSTATE_INTEGRATION, compiled.numbers
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, one, state, kind)
    mujoco.mj_setState(model, other, state, kind)
    if numbers[MEMORY.steps]:
        begin = MEMORY.left + model.nq + model.nv
        gained, motion = numbers[begin : begin + 2 * model.nv].reshape(2, model.nv), last_motion(numbers, model)
        scheme.resume(other, recollect(numbers, raw(numbers)), gained, motion, solved=compiled.solved)


_LIMIT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)


def _forces(data: mujoco.MjData) -> np.ndarray:
    """Return the forces of all rows except joint limits, because compiled code leaves out limits that are far away."""
    return data.efc_force[data.efc_type != _LIMIT]


def difference(one: mujoco.MjData, other: mujoco.MjData, *, forces: bool = True) -> float:
    """Return the largest difference of a field, relative to its size; forces of constraint rows can be left out."""
    assert one.time == other.time
    pairs = [(getattr(one, name), getattr(other, name)) for name in DERIVED]
    if forces:
        pairs.append((_forces(one), _forces(other)))
    return max(float(np.abs(a - b).max(initial=0.0)) / max(1.0, float(np.abs(b).max(initial=0.0))) for a, b in pairs)


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Which scenes to compare, and for how long."""

    only: tuple[str, ...] = ()
    """Names of scenes, or parts of names; all scenes if not given."""
    states: Count = 1000
    """Number of states per scene."""
    longest: Seconds = 60.0
    """Largest wall time of a scene, s; its row says if it ran out of time."""


def compare(scene: scenes.Scene, study: Agreement) -> dict[str, Any]:
    """Return a row: number of states compared, number of states that differ, largest difference, and why it stopped."""
    row: dict[str, Any] = {"scene": scene.name, "states": 0, "differ": 0, "largest": 0.0, "outcome": "fine"}
    try:
        loaded = scenes.load(scene)
        model, one = loaded.model, start(loaded, scene.raised)
        ours = compiled_stepper(model, _LAW, on_inadmissible="project")
        python = Stepper(model, _LAW, scheme="time-stepping", on_inadmissible="project", compiled="never")
        other, begun, found = mujoco.MjData(model), time.perf_counter(), []
        given = controls(model, "random", one.ctrl.copy(), study.states // HELD + 1, 0)
        for step in range(study.states):
            one.ctrl[:] = given[step // HELD]
            begin_alike(ours, python, one, other)
            ours.step(one)
            python.step(other)
            found.append(difference(one, other))
            if time.perf_counter() - begun > study.longest:
                row["outcome"] = "out of time"
                break
        row |= {"states": len(found), "differ": sum(d > CLOSE for d in found), "largest": max(found)}
    except Exception as error:
        row["outcome"] = f"{type(error).__name__}: {error}"[:80]
    return row


def main() -> None:
    """Compare the scenes of the command line, and print the table."""
    warnings.simplefilter("ignore")
    study = read(Agreement, __doc__)
    found = [compare(scene, study) for scene in tqdm(scenes.chosen(scenes.catalogue(), study.only), disable=None)]
    table = pd.DataFrame(found)
    with pd.option_context("display.width", 160, "display.max_rows", None):
        print(table.to_string(index=False, float_format=lambda x: f"{x:.1e}"))
    states, differ = (sum(row[name] for row in found) for name in ("states", "differ"))
    print(f"{differ} of {states} states differ by more than {CLOSE:g}")


if __name__ == "__main__":
    main()
