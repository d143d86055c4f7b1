"""Gymnasium's walkers on rigid contact with exact Coulomb friction, under random controls: its cost, and how it holds.

Rigid stepping and `mj_step` follow their own motions from the same start under the same controls, a step of one after
a step of the other. Both start with joints beyond their limits, as the environments do; rigid stepping pushes them out.
Times are processor time: other processes disturb it less.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium
import mujoco
import numpy as np
import pandas as pd
from benchmark_scenes import HELD
from benchmark_steps import FINE, timed
from benchmark_timing import MICRO

from impactlaw import ImpactLawError, Moreau, Stepper, read_contacts


@dataclass(frozen=True, kw_only=True)
class Walkers:
    """Which environments, for how long."""

    environments: tuple[str, ...] = ("Ant-v5", "Humanoid-v5")
    """Ids of gymnasium's MuJoCo environments, with their friction."""
    steps: int = 1000
    """Timesteps, without a reset."""
    restitution: float = 0.5
    """e of Moreau's law beside friction."""
    seed: int = 0
    """Of the start and the controls."""


def run(study: Walkers, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return one row per environment.

    Columns: steps; median_us, mean_us and worst_us of a rigid step; mj_median_us and mj_mean_us of `mj_step`; ratio of
    the medians, and mean_ratio; collisions; penetration, the deepest after any step, m or rad (joint limits are
    contacts too); unlocated, steps that ended with E = 0; speed, the largest at the end, m/s or rad/s; outcome, "fine"
    or why the stepping stopped.
    """
    table = []
    for name in study.environments:
        table.append(_walk(study, name))
        progress()
    return pd.DataFrame(table)


def _walk(study: Walkers, name: str) -> dict[str, object]:
    env = gymnasium.make(name).unwrapped
    env.reset(seed=study.seed)
    model, start = env.model, env.data  # pyright: ignore[reportAttributeAccessIssue]
    stepper = Stepper(model, Moreau(study.restitution), overlap="push-out")
    rigid, bare, seen = (mujoco.MjData(model) for _ in range(3))
    for data in (rigid, bare):
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
    rng = np.random.default_rng(study.seed)
    taken, bare_taken, collisions, deepest, outcome = [], [], 0, 0.0, FINE
    for number in range(study.steps):
        if number % HELD == 0:
            rigid.ctrl[:] = bare.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
        try:
            taken.append(timed(stepper.step, rigid, time.thread_time))
        except ImpactLawError as error:
            outcome = f"step {number}: {type(error).__name__}: {error}"
            break
        bare_taken.append(timed(lambda data: mujoco.mj_step(model, data), bare, time.thread_time))
        collisions += len(stepper.events)
        seen.qpos[:] = rigid.qpos
        deepest = max(deepest, -float(read_contacts(model, seen).gap.min(initial=0.0)))
    ours, theirs = MICRO * np.array(taken), MICRO * np.array(bare_taken)
    return {
        "environment": name,
        "nv": model.nv,
        "steps": len(ours),
        "median_us": np.median(ours),
        "mean_us": ours.mean(),
        "worst_us": ours.max(),
        "mj_median_us": np.median(theirs),
        "mj_mean_us": theirs.mean(),
        "ratio": np.median(ours) / np.median(theirs),
        "mean_ratio": ours.mean() / theirs.mean(),
        "collisions": collisions,
        "penetration": deepest,
        "unlocated": stepper.unlocated,
        "speed": float(np.abs(rigid.qvel).max()),
        "outcome": outcome,
    }
