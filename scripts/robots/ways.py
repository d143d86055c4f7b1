"""The ways to step a scene, MuJoCo's own among them."""

from __future__ import annotations

import contextlib
import copy
import time
from collections.abc import Callable
from typing import Any, Literal, get_args

import mujoco

from impactlaw import Moreau, Stepper
from impactlaw.stepping.time_stepping.make import warm_up as compiled_steps

Way = Literal["mujoco", "soft", "event-driven", "time-stepping"]
WAYS: tuple[Way, ...] = get_args(Way)
_OPTIONS: dict[Way, dict[str, Any]] = {
    "soft": {"contact_model": "soft"},
    "event-driven": {"contact_model": "rigid", "scheme": "event-driven", "overlap": "push-out"},
    "time-stepping": {"contact_model": "rigid", "scheme": "time-stepping", "overlap": "push-out"},
}
_WARM_STEPS = 100
_REHEARSAL = 1.0  # s
_WARM = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .0999"><freejoint/><geom type="box" size=".1 .1 .1" condim="6"/></body>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1" condim="4"/></body>
  <body pos="1 0 .15"><joint type="slide" axis="0 0 1" range="0 1" frictionloss="1" damping="1"/><geom size=".1"/>
    <body pos=".2 0 0"><joint name="a" axis="0 1 0"/><geom size=".05" condim="1"/></body></body>
  <body pos="2 0 .15"><joint name="b" axis="0 1 0"/><geom size=".1"/></body></worldbody>
  <equality><joint joint1="a" joint2="b"/></equality></mujoco>"""


def stepper(model: mujoco.MjModel, way: Way, restitution: float) -> Stepper:
    """Return the stepper of a way that has one: Moreau's law, exact friction."""
    return Stepper(model, Moreau(restitution), **_OPTIONS[way])


def step_of(model: mujoco.MjModel, way: Way, ours: Stepper | None) -> Callable[[mujoco.MjData], None]:
    """Return the function that advances data by one timestep."""
    if ours is None:
        return lambda data: mujoco.mj_step(model, data)
    return ours.step


def rehearse(model: mujoco.MjModel, start: mujoco.MjData, way: Way, restitution: float) -> None:
    """Take some steps of a copy of the scene, for the same reason; what they show is looked at in the case itself."""
    if way != "time-stepping":
        return
    ours, data = stepper(model, way, restitution), copy.copy(start)
    end = time.perf_counter() + _REHEARSAL
    with contextlib.suppress(Exception):
        for _ in range(_WARM_STEPS):
            if time.perf_counter() < end:
                ours.step(data)


def warm_up(way: Way, restitution: float) -> None:
    """Take some steps of another scene, so that what is loaded or compiled once is not counted."""
    if way == "mujoco":
        return
    if way == "event-driven":  # what it leaves undone is time stepped
        compiled_steps()
    model = mujoco.MjModel.from_xml_string(_WARM)
    ours, data = stepper(model, way, restitution), mujoco.MjData(model)
    data.qvel[model.nv - 3] = -1.0
    for _ in range(_WARM_STEPS):
        ours.step(data)
