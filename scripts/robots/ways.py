"""The ways to step a scene, MuJoCo's own among them."""

import contextlib
import copy
import time
from typing import Any, Literal, get_args

import mujoco

from impactlaw import Moreau, Stepper
from impactlaw.stepping.time_stepping.make import compile_steps

Way = Literal["mujoco", "soft", "event-driven", "time-stepping"]
WAYS: tuple[Way, ...] = get_args(Way)
_OPTIONS: dict[Way, dict[str, Any]] = {
    "soft": {"contact_model": "soft"},
    "event-driven": {"contact_model": "rigid", "scheme": "event-driven", "overlap": "push-out"},
    "time-stepping": {"contact_model": "rigid", "scheme": "time-stepping", "overlap": "push-out"},
}
_REHEARSED, _REHEARSAL = 100, 1.0  # largest number of steps of a rehearsal, and its longest time, s


def stepper(model: mujoco.MjModel, way: Way, restitution: float) -> Stepper:
    """Return the stepper of a way other than "mujoco", with Moreau's law and exact friction."""
    return Stepper(model, Moreau(restitution), **_OPTIONS[way])


def rehearse(model: mujoco.MjModel, start: mujoco.MjData, way: Way, restitution: float) -> None:
    """Take some steps of a copy of the scene, so that loading and compiling are not timed."""
    if way == "mujoco":
        return
    if way == "event-driven":  # time stepping takes the rest of its steps
        compile_steps()
    ours, data = stepper(model, way, restitution), copy.copy(start)
    end = time.perf_counter() + _REHEARSAL
    with contextlib.suppress(Exception):  # the case itself will raise it
        for _ in range(_REHEARSED):
            if time.perf_counter() < end:
                ours.step(data)
