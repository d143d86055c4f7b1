"""Error of trajectories against run time, over timesteps, methods and scenes."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from operator import attrgetter

import mujoco
import numpy as np

from impactlaw.errors import ImpactLawError

from .graph_distance import CompletedGraph
from .scenes import SCENES, Scene
from .trajectories import Trajectory, Way, rigid, soft, tuned

RK4, EULER = int(mujoco.mjtIntegrator.mjINT_RK4), int(mujoco.mjtIntegrator.mjINT_EULER)
Simulate = Callable[[Scene, mujoco.MjModel, mujoco.MjData, int], Trajectory]
Graphs = tuple[CompletedGraph, CompletedGraph]
"""The graph of the positions, and the graph of positions and velocities."""
LOCATED, TIME_STEPPING = "event-driven RK4", "time stepping"
"""The methods whose errors are compared with MuJoCo's."""
TUNED, DEFAULT = "MuJoCo tuned", "MuJoCo default"
"""Families of MuJoCo's soft contacts: tuned to the restitution, and with the default solref and solimp."""
_SMALLER = {TUNED: 0.0, TIME_STEPPING: 3e-5}  # families that also get smaller timesteps, and their lower bounds, s


@dataclass(frozen=True)
class Method:
    """A way to step a scene.

    Attributes:
        name: name in tables.
        family: methods of one family become one line of the picture, their lower envelope.
        simulate: maps scene, model with its timestep, start and number of steps to the trajectory.
        integrator: MuJoCo's integrator.
        order: maps a scene to the expected order.
    """

    name: str
    family: str
    simulate: Simulate
    integrator: int
    order: Callable[[Scene], float]


def _with_law(way: Way) -> Simulate:
    return lambda scene, model, start, steps: rigid(model, start, scene.law(model), steps, way=way)


def _default(timeconst: float | None) -> Simulate:
    def simulate(scene: Scene, model: mujoco.MjModel, start: mujoco.MjData, steps: int) -> Trajectory:
        if timeconst is not None:
            model.geom_solref[:, 0] = timeconst
        return soft(model, start, steps)

    return simulate


def _tuned(steps_in_contact: float) -> Simulate:
    return lambda scene, model, start, steps: soft(tuned(model, scene.restitution, steps_in_contact), start, steps)


def _methods() -> Iterator[Method]:
    integrators = (("RK4", RK4), ("Euler", EULER))
    for (name, integrator), order in zip(integrators, ("smooth_order", "euler_order"), strict=True):
        located = f"event-driven {name}"
        yield Method(located, located, _with_law("event-driven"), integrator, attrgetter(order))
    order = attrgetter("time_stepping_order")
    yield Method(TIME_STEPPING, TIME_STEPPING, _with_law("time-stepping"), EULER, order)
    for name, integrator in integrators:
        yield Method(f"soft layer {name}", "soft layer", _with_law("soft"), integrator, lambda _: np.nan)
    for name, integrator in integrators:
        for constant in (None, 5e-3, 1e-3):
            what = DEFAULT if constant is None else f"MuJoCo timeconst {constant:g}"
            yield Method(f"{what} {name}", DEFAULT, _default(constant), integrator, lambda _: 0.0)
        for steps in (10, 30, 100, 300):
            yield Method(f"{TUNED} {steps} {name}", TUNED, _tuned(steps), integrator, lambda _: np.nan)


METHODS = {method.name: method for method in _methods()}


def cells(
    *,
    scenes: tuple[str, ...] = tuple(SCENES),
    timesteps: tuple[float, ...] = tuple(10 ** (-1 - k / 2) for k in range(7)),
    methods: tuple[str, ...] = tuple(METHODS),
    finest: float = 0.0,
) -> Iterator[tuple[Scene, Method, float]]:
    """Yield every scene, method and timestep of the study.

    Args:
        scenes: names from `SCENES`.
        timesteps: timesteps of every method, s.
        methods: names from `METHODS`.
        finest: MuJoCo's tuned contacts and time stepping get timesteps down to this one, or to the scene's smallest if
            that is larger, s. Time stepping gets none below 3e-5 s, where it already runs longer than all others.
    """
    for scene in (SCENES[name] for name in scenes):
        for method in (METHODS[name] for name in methods):
            yield from ((scene, method, timestep) for timestep in timesteps)
            if method.family in _SMALLER:
                timestep = timesteps[-1] / np.sqrt(10)
                while timestep > 0.9 * max(scene.smallest, finest, _SMALLER[method.family]):
                    yield scene, method, timestep
                    timestep /= np.sqrt(10)


def run(cells: Iterable[tuple[Scene, Method, float]]) -> Iterator[dict[str, object]]:
    """Yield one row per cell: scene, method and timestep.

    Columns: scene; method; family; timestep, s (rounded so that it divides the duration); steps; seconds, processor
    time of the whole simulation; error, the largest scaled distance of a state from the reference's graph in (t, q)
    (see `graph_distance`); error_qv, the same in (t, q, v); expected_order; reference_error, the error of the reference
    itself; refused, the reason if the simulation was refused.
    """
    graphs: dict[str, tuple[Graphs, float]] = {}
    last = None
    for scene, method, timestep in cells:
        if scene.name not in graphs:
            graphs[scene.name] = reference_graph(scene)
        of_scene, uncertainty = graphs[scene.name]
        if (scene.name, method.name) != last:
            last = scene.name, method.name
            _row(scene, method, timestep, of_scene)  # loads compiled code
        yield _row(scene, method, timestep, of_scene) | {"reference_error": uncertainty}


def reference_graph(scene: Scene) -> tuple[Graphs, float]:
    """Return the graphs of the reference, and its distance to a reference with ten times the tolerance."""
    arcs = scene.reference(scene.duration, 1e-13)
    graphs = CompletedGraph(arcs, velocities=False), CompletedGraph(arcs)
    coarser = scene.reference(scene.duration, 1e-12)
    points = np.vstack([arc.points(np.linspace(arc.begin, arc.end, 100)) for arc in coarser])
    return graphs, float(graphs[1].distance(points).max())


def _row(scene: Scene, method: Method, timestep: float, graphs: Graphs) -> dict[str, object]:
    model, start = scene.load()
    steps = max(1, round(scene.duration / timestep))
    model.opt.timestep, model.opt.integrator = scene.duration / steps, method.integrator
    row: dict[str, object] = {"scene": scene.name, "method": method.name, "family": method.family}
    row |= {"timestep": model.opt.timestep, "steps": steps, **dict.fromkeys(("seconds", "error", "error_qv"), np.nan)}
    row |= {"expected_order": method.order(scene), "refused": ""}
    try:
        trajectory = method.simulate(scene, model, start, steps)
    except ImpactLawError as error:
        return row | {"refused": str(error)}
    finite = np.isfinite(trajectory.points).all()
    errors = [float(graph.distance(trajectory.points).max()) if finite else np.inf for graph in graphs]
    return row | {"seconds": trajectory.seconds, "error": errors[0], "error_qv": errors[1]}
