"""What a rigid step cannot cost less than: the calls into MuJoCo that it is made of, and nothing between them.

`mj_step` makes all of these calls in C. A step in Python makes them one by one, and what it decides in between, with
arrays of numpy at half a microsecond to two a call, has to fit into what is left of the time of `mj_step`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
import pandas as pd

from .scenes import Scene, builders
from .timing import in_turns

_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_CALLS = 20  # of each subject in a round


@dataclass(frozen=True, kw_only=True)
class Floor:
    """Which scenes, for how long."""

    scenes: tuple[str, ...] = ("box_drop", "falling_rod", "Hopper-v5", "Walker2d-v5", "Ant-v5", "Humanoid-v5")
    """Names from `benchmark_scenes`, of scenes with RK4."""
    steps: int = 400
    """Steps of `mj_step` after which they are measured, if there is a contact; else later."""
    seconds: float = 0.5
    """Time of each."""


def run(study: Floor, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return one row per scene, at a state of its motion under `mj_step` with a contact.

    Columns: contacts; mj_step_us; flight_us, the least of a step in which nothing is near: a flow without contacts, one
    look at positions and contacts; held_us, that of one which holds a contact that moves: the flow, two looks (before
    and after positions are corrected), gradients, and one impulse each for position and velocity; flight_left_us and
    held_left_us, what these leave of mj_step_us; left is negative where the calls alone cost more.
    """
    table = []
    environments = tuple(name for name in study.scenes if "-v" in name)
    for name in study.scenes:
        table.append(_of_scene(study, builders((), environments, full=True)[name]()))
        progress()
    return pd.DataFrame(table)


def _of_scene(study: Floor, scene: Scene) -> dict[str, object]:
    model, data = scene.model, mujoco.MjData(scene.model)
    step = partial(mujoco.mj_step, model)
    scene.begin(data, scene.starts[0], step)
    for number in range(scene.episode):
        scene.drive(data, number)
        step(data)
        if number >= study.steps and data.ncon:
            break
    state, contacts = np.empty(mujoco.mj_stateSize(model, _STATE)), data.ncon
    mujoco.mj_getState(model, data, state, _STATE)
    flags = model.opt.disableflags

    def prepared(call: Callable[[mujoco.MjData], object], flow: bool) -> list[Callable[[], object]]:
        model.opt.disableflags = flags | _NO_CONTACT if flow else flags
        mujoco.mj_setState(model, data, state, _STATE)
        mujoco.mj_forward(model, data)
        return [partial(call, data)] * _CALLS

    timed = in_turns(
        {
            "mj_step": lambda: prepared(step, False),
            "flow": lambda: prepared(step, True),
            "look": lambda: prepared(partial(_look, model), False),
            "hold": lambda: prepared(partial(_hold, model), False),
        },
        seconds=study.seconds,
    )
    whole, flow, look, hold = (timed.microseconds(name) for name in ("mj_step", "flow", "look", "hold"))
    flight, held = flow + look, flow + 2.0 * look + hold
    return {
        "scene": scene.name,
        "contacts": contacts,
        "mj_step_us": whole,
        "flight_us": flight,
        "flight_left_us": whole - flight,
        "held_us": held,
        "held_left_us": whole - held,
    }


def _look(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_makeM(model, data)
    mujoco.mj_collision(model, data)


def _hold(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    rows, shift = np.zeros((max(data.ncon, 1), model.nv)), np.zeros((1, model.nv))
    mujoco.mj_makeConstraint(model, data)
    mujoco.mj_factorM(model, data)
    mujoco.mj_solveM2(model, data, rows, rows, np.sqrt(data.qLDiagInv))
    mujoco.mj_solveM(model, data, shift, shift)
    mujoco.mj_integratePos(model, data.qpos, shift[0], 1.0)
    mujoco.mj_solveM(model, data, shift, shift)
