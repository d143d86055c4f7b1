"""Every scene of the package, and gymnasium's robots with friction and limits: does any collision create energy?

Each is run in rigid steps under every dissipative law, robots under random controls. A collision creates energy where
its energetic violation, beyond the work of moving surfaces and relative to |v-|, exceeds 1e-9.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import gymnasium
import machine
import mujoco
import numpy as np
import pandas as pd
import tyro
from tqdm import tqdm

from impactlaw import Law, MaximalDissipation, Moreau, Newton, Stepper
from impactlaw.models import load, scene_names

TOLERANCE = 1e-9
"""Energetic violation, relative to |v-|, that counts as rounding."""
LAWS: tuple[Law, ...] = (MaximalDissipation(), Moreau(0.5), Moreau(1.0), Newton(0.8))


@dataclass(frozen=True, kw_only=True)
class SceneEnergy:
    """What is run, and for how long."""

    robots: tuple[str, ...] = ("Hopper-v5", "Walker2d-v5", "HalfCheetah-v5", "Ant-v5", "Humanoid-v5")
    """Ids of gymnasium's MuJoCo environments."""
    steps: int = 500
    """Timesteps of each scene under each law; of a robot half as many."""
    quick: bool = False
    """40 timesteps, and the first robot only."""


def run(study: SceneEnergy, progress: Callable[[], object] = lambda: None) -> pd.DataFrame:
    """Return one row per scene and law: collisions, the largest energetic violation and residual, and penetration."""
    steps = 40 if study.quick else study.steps
    robots = study.robots[:1] if study.quick else study.robots
    rows = []
    for name, model, data in _scenes(robots):
        for law in LAWS:
            kept = mujoco.MjData(model)
            kept.qpos[:], kept.qvel[:] = data.qpos, data.qvel
            rows.append({"scene": name, "law": repr(law), **_watch(model, kept, law, steps // (1 + (name in robots)))})
            progress()
    return pd.DataFrame(rows)


def _scenes(robots: tuple[str, ...]) -> Iterator[tuple[str, mujoco.MjModel, mujoco.MjData]]:
    for name in scene_names():
        yield name, *load(name)
    for name in robots:
        env = gymnasium.make(name).unwrapped
        env.reset(seed=0)
        yield name, env.model, env.data  # pyright: ignore[reportAttributeAccessIssue]


def _watch(model: mujoco.MjModel, data: mujoco.MjData, law: Law, steps: int) -> dict[str, float]:
    stepper = Stepper(model, law, overlap="push-out", on_inadmissible="allow")
    rng = np.random.default_rng(0)
    collisions, energetic, residual = 0, 0.0, 0.0
    for step in range(steps):
        if step % 5 == 0 and model.nu:
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
        stepper.step(data)
        for event in stepper.events:
            violations = event.impact.violations
            collisions += 1
            energetic = max(energetic, violations.energetic / violations.pre_speed)
            residual = max(residual, event.impact.residual)
    return {"collisions": collisions, "energetic": energetic, "residual": residual}


def main(study: SceneEnergy) -> None:
    """Run the study and print the table."""
    robots = 1 if study.quick else len(study.robots)
    with tqdm(total=len(LAWS) * (len(scene_names()) + robots), disable=None, file=sys.stderr) as bar:
        table = run(study, bar.update)
    print(table.to_string(index=False, float_format="{:.1e}".format))
    worst = table.energetic.max()
    verdict = "no collision creates energy" if worst <= TOLERANCE else "ENERGY IS CREATED"
    print(f"\n{table.collisions.sum()} collisions: {verdict}, largest energetic violation {worst:.1e} of |v-|")
    print(machine.one_line())
    sys.exit(1 if worst > TOLERANCE else 0)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__, config=(tyro.conf.OmitArgPrefixes,))
