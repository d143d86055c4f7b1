"""Run time of environments: the wrapper `ImpactLaw`, single steps of robots, soft steps of a heap, our own tasks.

Both sides of a comparison repeat the same steps, in turns in one process. The steps are timed in short pieces, of which
the fastest time counts.
"""

import copy
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.vector import VectorEnv

from impactlaw import Moreau, Poisson, Stepper
from impactlaw.envs import ImpactLaw
from scripts.robots.scenes import Scene, load
from scripts.robots.starts import controls

from .timing import MICRO, Row, fastest, no_collection

ENVIRONMENTS = ("Hopper-v5", "Walker2d-v5", "HalfCheetah-v5", "Ant-v5", "Humanoid-v5")
RESTITUTION = 0.5  # of Moreau's law
_WORLDS = 256  # of tasks
_PIECE = 10  # environment steps, or steps of a heap
_QUADRUPED = Scene("dm/quadruped", "dm_control", "quadruped walk")
_HELD = 5  # steps of a robot for which controls are held
_SHAPES = ("box", "sphere", "capsule", "cylinder", "ellipsoid")


def run_wrappers(wrapped: tuple[str, ...] = ENVIRONMENTS, *, steps: int = 400, repetitions: int = 15) -> Iterator[Row]:
    """Yield one row per environment: microseconds of a step, plain and wrapped, and their ratio.

    Args:
        wrapped: ids of gymnasium's MuJoCo environments.
        steps: environment steps per run; an episode that ends earlier is reset.
        repetitions: number of runs.
    """
    for name in wrapped:
        envs = {"plain": gymnasium.make(name), "wrapped": ImpactLaw(gymnasium.make(name), "moreau", RESTITUTION)}
        actions = _actions(envs["plain"], steps)
        taken = fastest({kind: partial(_episode, env, actions) for kind, env in envs.items()}, repetitions)
        row: Row = {f"{kind}_us": MICRO * seconds / steps for kind, seconds in taken.items()}
        yield {"environment": name} | row | {"ratio": taken["wrapped"] / taken["plain"]}


def _actions(env: gymnasium.Env, steps: int) -> list[Any]:
    """Return random actions, the same ones in every call."""
    env.action_space.seed(0)
    return [env.action_space.sample() for _ in range(steps)]


def _episode(env: gymnasium.Env, actions: list[Any]) -> np.ndarray:
    """Return the time of each piece, s."""
    env.reset(seed=0)
    seconds = []
    bounds = [*range(0, len(actions), _PIECE), len(actions)]
    for first, last in pairwise(bounds):
        with no_collection():
            start = time.perf_counter()
            for number in range(first, last):
                _, _, terminated, truncated, _ = env.step(actions[number])
                if terminated or truncated:
                    env.reset(seed=number)
            seconds.append(time.perf_counter() - start)
    return np.array(seconds)


def run_robots(
    robots: tuple[str, ...] = (*ENVIRONMENTS, "dm/quadruped"), *, steps: int = 2000, repetitions: int = 8
) -> Iterator[Row]:
    """Yield one row per robot and integrator: microseconds of a step of MuJoCo, of time stepping and of soft stepping.

    The law is Moreau's with e = 0, and friction is exact; Poisson's law is one that time stepping asks in Python. The
    integrators are the model's own and Euler.

    Args:
        robots: ids of gymnasium's MuJoCo environments, or dm_control's quadruped.
        steps: timesteps per run, under random controls that change every five timesteps.
        repetitions: number of runs, each from the start; at most three for Poisson's law.
    """
    for name in robots:
        scene = _QUADRUPED if name == _QUADRUPED.name else Scene(name, "gymnasium", name)
        shipped = load(scene).model.opt.integrator
        for integrator in dict.fromkeys((shipped, int(mujoco.mjtIntegrator.mjINT_EULER))):
            model = load(scene).model
            model.opt.integrator = integrator
            ways: dict[str, Callable[[mujoco.MjData], object]] = {
                "mujoco": partial(mujoco.mj_step, model),
                "time_stepping": Stepper(model, Moreau(0.0), scheme="time-stepping").step,
                "soft": Stepper(model, Moreau(0.0), contact_model="soft").step,
            }
            asked: dict[str, Callable[[mujoco.MjData], object]] = {
                "poisson": Stepper(model, Poisson(0.5), scheme="time-stepping").step
            }
            pieces = -(-steps // _HELD)
            taken: dict[str, float] = {}
            for some, runs in ((ways, repetitions), (asked, min(3, repetitions))):
                taken |= fastest({way: partial(_drive, model, step, pieces) for way, step in some.items()}, runs)
            row: Row = {"robot": name, "integrator": mujoco.mjtIntegrator(integrator).name[6:]}
            row |= {f"{way}_us": MICRO * seconds / (pieces * _HELD) for way, seconds in taken.items()}
            ratios = {f"{way}_ratio": taken[way] / taken["mujoco"] for way in taken if way != "mujoco"}
            yield row | ratios | {"shipped": integrator == shipped}


def _drive(model: mujoco.MjModel, step: Callable[[mujoco.MjData], object], pieces: int) -> np.ndarray:
    """Return the time of each piece of steps, s, under controls that are random but the same in each run."""
    data, seconds = mujoco.MjData(model), []
    for control in controls(model, "random", data.ctrl, pieces, 0):
        data.ctrl[:] = control
        seconds.append(_timed(step, data, _HELD))
    return np.array(seconds)


def _timed(step: Callable[[mujoco.MjData], object], data: mujoco.MjData, steps: int) -> float:
    """Return the time of some steps, s."""
    with no_collection():
        start = time.perf_counter()
        for _ in range(steps):
            step(data)
        return time.perf_counter() - start


def run_heaps(bodies: tuple[int, ...] = (10, 30, 100), *, steps: int = 500, repetitions: int = 5) -> Iterator[Row]:
    """Yield one row per heap: microseconds of a step of MuJoCo and of soft stepping, and their ratio.

    Args:
        bodies: numbers of bodies: boxes, balls, capsules, cylinders and ellipsoids in turn.
        steps: timesteps of 2 ms per run.
        repetitions: number of runs.
    """
    for number in bodies:
        runs = [_fall(heap(number), steps) for _ in range(repetitions)]
        plain, soft = MICRO * np.min(runs, axis=0).sum(axis=1) / steps
        yield {"bodies": number, "mujoco_us": plain, "soft_us": soft, "ratio": soft / plain}


def heap(bodies: int) -> mujoco.MjModel:
    """Return a scene of bodies of five shapes above a floor, which fall onto each other."""
    random = np.random.default_rng(0)
    world = '<geom type="plane" size="2 2 1"/>'
    for i in range(bodies):
        x, y = random.uniform(-0.15, 0.15, 2)
        kind = _SHAPES[i % len(_SHAPES)]
        world += f'<body pos="{x} {y} {0.1 + 0.03 * i}"><freejoint/><geom type="{kind}" size=".05 .05 .05"/></body>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{world}</worldbody></mujoco>")


def _fall(model: mujoco.MjModel, steps: int) -> np.ndarray:
    """Return the time of each piece, s, by MuJoCo and soft, (2, pieces); both start where the last soft piece ended."""
    stepper, data, seconds = Stepper(model, Moreau(RESTITUTION), contact_model="soft"), mujoco.MjData(model), []
    ways: tuple[Callable[[mujoco.MjData], object], ...] = (lambda data: mujoco.mj_step(model, data), stepper.step)
    for _ in range(0, steps, _PIECE):
        seconds.append([_timed(step, at, _PIECE) for at, step in zip((copy.copy(data), data), ways, strict=True)])
    return np.array(seconds).T


def run_tasks(
    tasks: tuple[str, ...] = ("Juggler", "RockingBlock", "Billiards"), *, actions: int = 1000, repetitions: int = 3
) -> Iterator[Row]:
    """Yield one row per task and scheme: environment steps per second under random actions, resets included.

    Tasks with a vector environment are also stepped in many worlds, by all threads.

    Args:
        tasks: names of `impactlaw/...-v0`.
        actions: environment steps per run.
        repetitions: number of runs.
    """
    for name in tasks:
        for scheme in ("event-driven", "time-stepping"):
            env = gymnasium.make(f"impactlaw/{name}-v0", scheme=scheme)
            taken = fastest({scheme: partial(_episode, env, _actions(env, actions))}, repetitions)
            env.close()
            yield {"task": name, "scheme": scheme, "steps_per_second": actions / taken[scheme]}
        if gymnasium.spec(f"impactlaw/{name}-v0").vector_entry_point is not None:
            worlds = gymnasium.make_vec(f"impactlaw/{name}-v0", _WORLDS, "vector_entry_point")
            rate = steps_per_second(worlds, max(1, actions // _PIECE), repetitions)
            yield {"task": name, "scheme": f"{_WORLDS} worlds", "steps_per_second": rate}


def steps_per_second(worlds: VectorEnv, calls: int, times: int = 1) -> float:
    """Return the environment steps per second of many worlds under random actions, by the fastest run of the calls."""
    worlds.action_space.seed(0)
    worlds.reset(seed=0)
    actions = [worlds.action_space.sample() for _ in range(_PIECE)]
    for action in actions:
        worlds.step(action)
    best = np.inf
    for _ in range(times):
        start = time.perf_counter()
        for call in range(calls):
            worlds.step(actions[call % _PIECE])
        best = min(best, time.perf_counter() - start)
    worlds.close()
    return worlds.num_envs * calls / best
