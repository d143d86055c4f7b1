"""What a collision costs from (model, data) to v+: reading the contacts, and the law."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
import pandas as pd
from benchmark_laws import fresh
from benchmark_scenes import Scene, builders
from benchmark_timing import in_turns

from impactlaw import Collision, Stepper

_SLOW = 1.0
"""Seconds above which a call is timed three times only."""


@dataclass(frozen=True, kw_only=True)
class ImpactCost:
    """Which scenes, for how long."""

    cradles: tuple[int, ...] = (5, 100, 1000)
    """Balls of the cradles."""
    environments: tuple[str, ...] = ("Ant-v5", "Humanoid-v5", "Hopper-v5", "Walker2d-v5")
    """Ids of gymnasium's MuJoCo environments."""
    full: bool = True
    """With every scene of models/."""
    seconds: float = 1.0
    """Time per scene."""
    steps: int = 500
    """Steps within which the first collision is looked for."""


def names(study: ImpactCost) -> list[str]:
    """Return the scenes to come."""
    found = builders(study.cradles, study.environments, full=study.full)
    return [name for name in found if "at rest" not in name and "Euler" not in name and name != "64 coplanar"]


def run(study: ImpactCost, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return one row per scene whose first collision was met.

    Columns: h, nv; read_us (`Collision.from_mujoco`), resolve_us (`Law.resolve` on what was read), total_us (both);
    law_us (`Law.resolve` from (Y, v-)); mj_step_us (of the same state, for comparison); residual.
    """
    table = []
    for name in names(study):
        scene = builders(study.cradles, study.environments, full=study.full)[name]()
        data = first_collision(scene, study.steps)
        if data is not None:
            table.append(_row(study, scene, data))
        progress()
    return pd.DataFrame(table)


def first_collision(scene: Scene, steps: int) -> mujoco.MjData | None:
    """Return the state in which the scene's first collision happens; None if there is none within some steps."""
    data = mujoco.MjData(scene.model)
    scene.begin(data, scene.starts[0], lambda data: None)
    closing = Collision.from_mujoco(scene.model, data).pre_contact_velocity
    if closing.min(initial=0.0) < -1e-6:
        return data
    stepper = Stepper(scene.model, scene.law, friction=scene.friction)
    for number in range(min(steps, scene.episode)):
        scene.drive(data, number)
        stepper.step(data)
        if stepper.events:
            event = stepper.events[0]
            data.qpos[:], data.qvel[:] = event.qpos, event.impact.collision.pre_velocity
            return data
    return None


def _row(study: ImpactCost, scene: Scene, data: mujoco.MjData) -> dict[str, object]:
    model, law = scene.model, scene.law
    start = time.perf_counter()
    collision = Collision.from_mujoco(model, data)
    impact = law.resolve(collision)
    rounds = 2 if time.perf_counter() - start > _SLOW else 5
    state = data.qpos.copy(), data.qvel.copy()
    calls = max(1, 100 // len(collision.labels)) if rounds > 2 else 1

    stepped = mujoco.MjData(model)

    def step() -> list[Callable[[], object]]:
        mujoco.mj_resetData(model, stepped)
        stepped.qpos[:], stepped.qvel[:] = state
        return [partial(mujoco.mj_step, model, stepped)]

    subjects = {
        "read": lambda: [partial(Collision.from_mujoco, model, data)] * calls,
        "resolve": lambda: [partial(law.resolve, Collision.from_mujoco(model, data)) for _ in range(calls)],
        "law": lambda: [partial(law.resolve, fresh(collision)) for _ in range(calls)],
        "mj_step": step,
    }
    timed = in_turns(subjects, seconds=study.seconds, fewest=rounds)
    row: dict[str, object] = {
        "scene": scene.name,
        "h": len(collision.labels),
        "nv": model.nv,
        "law": type(law).__name__,
    }
    row |= {f"{name}_us": timed.microseconds(name) for name in subjects}
    row["total_us"] = 1e6 * float(np.median(timed.seconds["read"] + timed.seconds["resolve"]))
    return row | {"residual": impact.residual}
