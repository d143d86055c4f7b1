"""The ways to step a scene, MuJoCo's own among them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, get_args

import mujoco

from impactlaw import Moreau, Stepper

Way = Literal["mujoco", "soft", "event-driven", "time-stepping"]
WAYS: tuple[Way, ...] = get_args(Way)
_OPTIONS: dict[Way, dict[str, Any]] = {
    "soft": {"contact_model": "soft"},
    "event-driven": {"contact_model": "rigid", "scheme": "event-driven", "overlap": "push-out"},
    "time-stepping": {"contact_model": "rigid", "scheme": "time-stepping", "overlap": "push-out"},
}
_WARM = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .0999"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body pos="1 0 .1"><joint type="slide" axis="0 0 1" range="0 1"/><geom size=".1"/></body></worldbody></mujoco>"""


def stepper(model: mujoco.MjModel, way: Way, restitution: float) -> Stepper:
    """Return the stepper of a way that has one: Moreau's law, exact friction."""
    return Stepper(model, Moreau(restitution), friction="coulomb", **_OPTIONS[way])


def step_of(model: mujoco.MjModel, way: Way, ours: Stepper | None) -> Callable[[mujoco.MjData], None]:
    """Return the function that advances data by one timestep."""
    if ours is None:
        return lambda data: mujoco.mj_step(model, data)
    return ours.step


def warm_up(way: Way, restitution: float) -> None:
    """Take some steps of another scene, so that what is loaded or compiled once is not counted."""
    if way == "mujoco":
        return
    model = mujoco.MjModel.from_xml_string(_WARM)
    ours, data = stepper(model, way, restitution), mujoco.MjData(model)
    for _ in range(5):
        ours.step(data)
