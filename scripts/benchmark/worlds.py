"""Many worlds at once: `Batch` next to MuJoCo's own batch, and vector environments next to processes.

All batches get the same random controls, in turns. MuJoCo's batch runs with the model's own integrator and with Euler.
"""

import copy
import os
import time
from collections.abc import Iterator
from itertools import product
from typing import Any

import gymnasium
import mujoco
import mujoco.batch
import numpy as np

from impactlaw import Batch, Moreau
from impactlaw.envs import ImpactLaw

from .environments import ENVIRONMENTS, RESTITUTION, steps_per_second
from .timing import Row

OURS, SOFT, SHIPPED, EULER = "impactlaw", "impactlaw, soft", "mujoco", "mujoco, Euler"
_TIMESTEPS = 5  # per call
_MANY, _LEAST = 256, 3  # number of worlds from which fewer calls are timed, and the least number of these


def _batches(model: mujoco.MjModel, worlds: int, threads: int) -> dict[str, Any]:
    euler = copy.copy(model)
    euler.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    return {
        OURS: Batch(model, Moreau(RESTITUTION), worlds, threads),
        SOFT: Batch(model, Moreau(RESTITUTION), worlds, threads, contact_model="soft"),
        SHIPPED: mujoco.batch.Batch(model, worlds, threads),
        EULER: mujoco.batch.Batch(euler, worlds, threads),
    }


def run(
    tasks: tuple[str, ...] = ENVIRONMENTS,
    *,
    counts: tuple[int, ...] = (1, 16, 256, 1024, 4096),
    threads: tuple[int, ...] = tuple(sorted({1, 2, os.cpu_count() or 1})),
    calls: int = 20,
) -> Iterator[Row]:
    """Yield one row per task, number of worlds and number of threads.

    Columns: timesteps per second of our rigid steps; their ratio to MuJoCo's batch with the model's own integrator and
    with Euler (the first is NaN for models whose own integrator is Euler); and the ratio of soft steps, with the
    model's own integrator.

    Args:
        tasks: ids of gymnasium's MuJoCo environments.
        counts: numbers of worlds.
        threads: numbers of threads.
        calls: number of timed calls of five timesteps each, after as many untimed ones; fewer for many worlds.
    """
    for task in tasks:
        model: Any = gymnasium.make(task).unwrapped.model  # pyright: ignore[reportAttributeAccessIssue]
        for worlds, nthread in product(counts, threads):
            batches, rng = _batches(model, worlds, nthread), np.random.default_rng(0)
            seconds: dict[str, list[float]] = {name: [] for name in batches}
            timed = min(calls, max(_LEAST, calls * _MANY // worlds))
            for call in range(2 * timed):
                controls = rng.uniform(-1.0, 1.0, (worlds, model.nu))
                for name, batch in batches.items():
                    batch.bind("ctrl")[:] = controls
                    start = time.perf_counter()
                    batch.step(nstep=_TIMESTEPS)
                    if call >= timed:
                        seconds[name].append(time.perf_counter() - start)
            rate = {name: worlds * _TIMESTEPS / float(np.median(taken)) for name, taken in seconds.items()}
            row: Row = {"task": task, "worlds": worlds, "threads": nthread, "steps_per_s": rate[OURS]}
            euler = model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_EULER)
            row |= {"to_shipped": np.nan if euler else rate[OURS] / rate[SHIPPED]}
            yield row | {"to_euler": rate[OURS] / rate[EULER], "soft_to_shipped": rate[SOFT] / rate[SHIPPED]}


def _wrapped() -> gymnasium.Env:
    return ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", RESTITUTION, contact_model="rigid", scheme="time-stepping")


def run_vector(worlds: int = 256, *, steps: int = 20_000) -> Iterator[Row]:
    """Yield the environment steps per second of worlds of Hopper in this process, and of as many processes as cores.

    The worlds take so many steps in total, the processes a tenth of them.
    """
    ours = gymnasium.make_vec("impactlaw.envs:impactlaw/Hopper-v5", worlds, "vector_entry_point")
    rate, many = steps_per_second(ours, max(1, steps // worlds)), os.cpu_count() or 1
    yield {"environments": f"{worlds} worlds", "steps_per_s": rate}
    processes = gymnasium.vector.AsyncVectorEnv([_wrapped] * many)
    rate = steps_per_second(processes, max(1, steps // 10 // many))
    yield {"environments": f"{many} processes", "steps_per_s": rate}
