"""What soft stepping costs: a step without a collision, and one with, next to a bare `mj_step` of the same state.

Both are timed step by step in one process, in alternating order, along episodes of random actions of gymnasium's
environments as shipped. The ratio is the median, over batches of steps without a collision, of the ratio of medians.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium
import mujoco
import numpy as np
import pandas as pd
import tyro

from impactlaw import Stepper, make_law

GOALS = {"Ant-v5": 1.15, "Humanoid-v5": 1.15, "Hopper-v5": 1.25, "Walker2d-v5": 1.25}
"""Largest ratio of a soft step without a collision to `mj_step` that the project allows itself."""


@dataclass(frozen=True)
class SoftCost:
    """Which environments to time, for how long, under which law."""

    environments: tuple[str, ...] = tuple(GOALS)
    """Ids of gymnasium's MuJoCo environments."""
    steps: int = 20_000
    """Timesteps per environment."""
    batch: int = 200
    """Steps without a collision per batch."""
    law: str = "moreau"
    """The law by name."""
    restitution: float | None = 0.5
    """What it takes."""
    seed: int = 0
    """Seed of the episodes."""


def run(study: SoftCost) -> pd.DataFrame:
    """Return one row per environment: microseconds per step, the ratio, the cost of a step with a collision."""
    return pd.DataFrame([_time_environment(study, name) for name in study.environments])


def _time_environment(study: SoftCost, name: str) -> dict[str, object]:
    env = gymnasium.make(name).unwrapped
    env.reset(seed=study.seed)
    env.action_space.seed(study.seed)
    model, soft = env.model, env.data  # pyright: ignore[reportAttributeAccessIssue]
    bare = mujoco.MjData(model)
    stepper = Stepper(model, make_law(study.law, study.restitution), contact_model="soft")
    plain, collided = [], []
    for i in range(study.steps):
        if i % env.frame_skip == 0:  # pyright: ignore[reportAttributeAccessIssue]
            if not env.is_healthy:  # pyright: ignore[reportAttributeAccessIssue]
                env.reset()
            soft.ctrl[:] = env.action_space.sample()
        mujoco.mj_copyData(bare, model, soft)
        pair = _time_pair(lambda: mujoco.mj_step(model, bare), lambda: stepper.step(soft), soft_first=i % 2 == 0)
        (collided if stepper.events else plain).append(pair)
    return _row(study, name, model, np.array(plain), np.array(collided).reshape(-1, 2))


def _time_pair(bare: Callable[[], None], soft: Callable[[], None], *, soft_first: bool) -> tuple[float, float]:
    """Return microseconds of both."""
    first, second = (soft, bare) if soft_first else (bare, soft)
    start = time.perf_counter()
    first()
    middle = time.perf_counter()
    second()
    end = time.perf_counter()
    of_first, of_second = 1e6 * (middle - start), 1e6 * (end - middle)
    return (of_second, of_first) if soft_first else (of_first, of_second)


def _row(
    study: SoftCost, name: str, model: mujoco.MjModel, plain: np.ndarray, collided: np.ndarray
) -> dict[str, object]:
    count = len(plain) // study.batch
    batches = plain[: count * study.batch].reshape(count, study.batch, 2)
    medians = np.median(batches, axis=1)
    return {
        "environment": name,
        "integrator": mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_"),
        "nv": model.nv,
        "batches": count,
        "mj_step_us": np.median(plain[:, 0]),
        "soft_us": np.median(plain[:, 1]),
        "ratio": np.median(medians[:, 1] / medians[:, 0]),
        "goal": GOALS.get(name, np.nan),
        "collisions": len(collided),
        "collision_us": np.median(collided[:, 1]) if len(collided) else np.nan,
    }


def main() -> None:
    """Run the study from the command line and print its table."""
    table = run(tyro.cli(SoftCost, description=__doc__))
    print(table.to_string(index=False, float_format=lambda x: f"{x:.3g}"))


if __name__ == "__main__":
    main()
