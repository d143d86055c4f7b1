"""Do steps with a law in compiled code, and steps that ask it in Python, agree on the scenes of this study?

``python -m scripts.robots.agreement``: each scene is stepped under random controls, with the law in compiled code.
Every step is repeated from the same state and memory, with the law asked in Python. Differences are relative to the
size of each field.
"""

import time
import warnings
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from tqdm import tqdm

from impactlaw import Law, Newton, Stepper
from impactlaw.stepping.time_stepping.compiled.state.memory import raw, restore
from impactlaw.stepping.time_stepping.scheme import TimeStepping
from scripts.options import Count, Seconds, read

from . import scenes
from .starts import HELD, controls, start

CLOSE = 1e-10
"""Largest difference that counts as rounding."""

_LAW = Newton({"*": 0.5})  # from a table, or asked in Python
DERIVED = (
    "qpos",
    "qvel",
    "qacc",
    "sensordata",
    "qfrc_constraint",
    "act",
    "xpos",
    "cvel",
    "qacc_warmstart",
    "efc_force",
)


def compiled_stepper(model: mujoco.MjModel, law: Law, **options: object) -> Stepper:
    """Return a stepper with time steps whose law is not asked in Python."""
    stepper = Stepper(model, law, scheme="time-stepping", compiled="auto", **options)  # pyright: ignore[reportArgumentType]
    assert isinstance(stepper.stepping, TimeStepping)
    assert not stepper.stepping.law.asks
    return stepper


def begin_alike(ours: Stepper, python: Stepper, one: mujoco.MjData, other: mujoco.MjData) -> None:
    """Give another stepper the state and the memory that the next step starts from."""
    model, mine, theirs = ours.model, ours.stepping, python.stepping
    assert isinstance(mine, TimeStepping)
    assert isinstance(theirs, TimeStepping)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, one, state, kind)
    mujoco.mj_setState(model, other, state, kind)
    for update in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
        update(model, other)
    restore(theirs.numbers, mine.numbers.copy(), raw(mine.numbers))


def difference(one: mujoco.MjData, other: mujoco.MjData) -> float:
    """Return the largest difference of a field, relative to its size."""
    assert one.time == other.time
    pairs = [(getattr(one, name), getattr(other, name)) for name in DERIVED]
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
