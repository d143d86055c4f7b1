"""Where the time of a rigid step goes: Python's calls, by the time spent in themselves."""

from __future__ import annotations

import cProfile
import pstats
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import pandas as pd
from benchmark_scenes import Scene, builders

from impactlaw import Stepper


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Which scenes, how many steps, how long a table."""

    scenes: tuple[str, ...] = ("cradle 5", "box at rest")
    """Names from `benchmark_scenes`."""
    steps: int = 1000
    """Rigid steps of each."""
    top: int = 10
    """Functions listed."""


def run(study: Profile, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return the functions with the most time of their own, for each scene.

    Columns: function; calls per step; own_us and whole_us per step, with and without what it calls, both with the
    profiler's own cost in it; share of own time; step_us, the mean of a step without the profiler.
    """
    table = []
    for name in study.scenes:
        table += _of_scene(study, builders((5,), (), full=False)[name]())
        progress()
    return pd.DataFrame(table)


def _of_scene(study: Profile, scene: Scene) -> list[dict[str, object]]:
    stepper, data = Stepper(scene.model, scene.law), mujoco.MjData(scene.model)
    scene.begin(data, scene.starts[0], stepper.step)
    start = time.perf_counter()
    _step(study, stepper, data)
    step_us = 1e6 * (time.perf_counter() - start) / study.steps
    profiler = cProfile.Profile()
    profiler.enable()
    _step(study, stepper, data)
    profiler.disable()
    stats = pstats.Stats(profiler).stats  # pyright: ignore[reportAttributeAccessIssue]
    total = sum(entry[2] for entry in stats.values())
    largest = sorted(stats.items(), key=lambda item: -item[1][2])[: study.top]
    return [
        {
            "scene": scene.name,
            "function": _name(*function),
            "calls": calls / study.steps,
            "own_us": 1e6 * own / study.steps,
            "whole_us": 1e6 * whole / study.steps,
            "share": own / total,
            "step_us": step_us,
        }
        for function, (_, calls, own, whole, _) in largest
    ]


def _step(study: Profile, stepper: Stepper, data: mujoco.MjData) -> None:
    for _ in range(study.steps):
        stepper.step(data)


def _name(file: str, line: int, function: str) -> str:
    if file == "~":
        return function.strip("<>").removeprefix("built-in method ").removeprefix("method ")
    path = Path(file)
    return f"{path.parent.name}/{path.name}:{line} {function}"
