"""Run time of each part that a scene's plan leaves out of event-driven steps: the same steps with the part put back.

The trial of the last contact forces is a shortcut that leaves out contacts while nothing moves; it is removed instead.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import mujoco
import numpy as np

from impactlaw import MaximalDissipation, Moreau
from impactlaw.scene.tolerances import GAP_TOLERANCE
from impactlaw.stepping.collisions import Collider
from impactlaw.stepping.event_driven.scheme import RigidStepping
from impactlaw.stepping.plan import Plan, make_plan

from .scenes import Scene, builders
from .timing import Row, in_turns

LATER = ("friction", "bilateral", "surfaces")
"""Flags of friction, equality constraints and moving surfaces, which must not slow down scenes without them."""

REST = "rest, taken away"
"""Name of the part without which steps are slower: the trial of the last contact forces."""

_OPTIONAL = ("detection", "convex", "faces", "passing", "turning", "inertia", *LATER)
"""Flags of a plan that switch parts of event-driven steps."""
_PENDULUM = """<mujoco model="pendulum"><option timestep=".005" integrator="RK4"/><worldbody><body>
<joint type="hinge" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -1" contype="0" conaffinity="0"/>
</body></worldbody></mujoco>"""
_SCENES = "pendulum", "bouncing_ball", "cradle 5", "box_drop", "box at rest", "billiard_rack", "juggler"


def run(scenes: tuple[str, ...] = _SCENES, *, steps: int = 100, seconds: float = 2.0) -> Iterator[Row]:
    """Yield one row per scene and part left out.

    Columns: planned_us and forced_us per step (mean over a run, median over runs), ratio of forced to planned;
    difference, the largest change of a position at the end, which is 0 for a part that is not needed.

    Args:
        scenes: names from `scripts.benchmark.scenes`, or "pendulum", which has no contacts.
        steps: timesteps of each run, from the start.
        seconds: processor time per scene.
    """
    for name in scenes:
        yield from _rows(_scene(name), steps, seconds)


def _scene(name: str) -> Scene:
    if name != "pendulum":
        return builders((5,), (), full=True)[name]()
    model = mujoco.MjModel.from_xml_string(_PENDULUM)
    return Scene(name=name, model=model, law=Moreau(0.5), starts=((np.array([1.0]), np.zeros(1)),))


def _rows(scene: Scene, steps: int, seconds: float) -> Iterator[Row]:
    plan = make_plan(scene.model)
    forced = {name: replace(plan, **{name: True}) for name in _OPTIONAL if not getattr(plan, name)}
    if plan.rest:
        forced[REST] = replace(plan, rest=False)
    if not forced:
        return
    runs = {name: _Run(scene, version, steps) for name, version in {"planned": plan, **forced}.items()}
    timed = in_turns({name: run.prepare for name, run in runs.items()}, seconds=seconds, clock=time.thread_time)
    planned = timed.microseconds("planned") / steps
    for name in forced:
        us = timed.microseconds(name) / steps
        row: Row = {"scene": scene.name, "left_out": name}
        row |= {"planned_us": planned, "forced_us": us, "ratio": timed.ratio(name, "planned")}
        yield row | {"difference": float(np.abs(runs[name].data.qpos - runs["planned"].data.qpos).max())}


class _Run:
    """A run of one scene under one plan, from the start."""

    def __init__(self, scene: Scene, plan: Plan, steps: int):
        self._scene, self._steps = scene, steps
        self.data = mujoco.MjData(scene.model)
        collider = Collider(scene.law, MaximalDissipation(), "raise", 100, "auto")
        self._step = RigidStepping(scene.model, collider, plan, exact=True, gap_tolerance=GAP_TOLERANCE).step

    def prepare(self) -> list[Callable[[], object]]:
        """Go back to the start, and return the call that takes all steps of the run."""
        self._scene.begin(self.data, self._scene.starts[0], self._step)
        return [lambda: [self._step(self.data) for _ in range(self._steps)]]
