"""Order of time stepping, averaged over the positions of impacts within a step."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.stats import linregress

from .scenes import SCENES, Scene
from .stepping import EULER, reference_graph
from .trajectories import rigid

_NEIGHBORS = 1.2  # ratio of the largest to the smallest timestep of a group


def slope(timesteps: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """Return the slope of log(error) over log(timestep), and its standard error.

    Args:
        timesteps: timestep of each group, s, (groups,).
        errors: errors of each group, (groups, n), which are averaged.
    """
    fit: Any = linregress(np.log(timesteps), np.log(np.mean(errors, axis=1)))
    return float(fit.slope), float(fit.stderr)


def time_stepping_orders(
    scenes: tuple[str, ...] = tuple(SCENES), *, groups: int = 5, neighbors: int = 8
) -> Iterator[dict[str, object]]:
    """Yield one row per scene: the order of time stepping in (t, q), with its standard error.

    The error of one run depends on where within a step each impact falls, which is as good as random. The mean over
    neighboring timesteps averages this out, as a mean over many starts would, but needs a single reference.

    Columns: scene; expected; order and its standard error; from and to, the smallest and the largest group of
    timesteps, s.

    Args:
        scenes: names from `SCENES`.
        groups: number of groups of timesteps, each half as large as the one before, from the scene's largest on.
        neighbors: number of timesteps of a group, all within 20 %.
    """
    for scene in (SCENES[name] for name in scenes):
        begin = scene.time_stepping_from * 0.5 ** np.arange(groups)
        order, about = slope(begin, _errors(scene, np.outer(begin, np.geomspace(1 / _NEIGHBORS, 1.0, neighbors))))
        row: dict[str, object] = {"scene": scene.name, "expected": scene.time_stepping_order, "order": order}
        yield row | {"+-": about, "from": begin[-1], "to": begin[0]}


def _errors(scene: Scene, timesteps: np.ndarray) -> np.ndarray:
    """Return the errors of runs with these timesteps, in (t, q)."""
    (graph, _), _ = reference_graph(scene)
    errors = np.empty(timesteps.size)
    for i, timestep in enumerate(timesteps.flat):
        model, start = scene.load()
        steps = round(scene.duration / timestep)
        model.opt.timestep, model.opt.integrator = scene.duration / steps, EULER
        points = rigid(model, start, scene.law(model), steps, way="time-stepping", repeat=False).points
        errors[i] = graph.distance(points).max()
    return errors.reshape(timesteps.shape)
