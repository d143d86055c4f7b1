"""Work and precision of stepping: error of trajectories against run time, over timesteps, methods and scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import pandas as pd
import references
from graph_distance import Arc, CompletedGraph
from trajectories import Trajectory, rigid, soft, time_stepping, tuned

from impactlaw import Fremond, Law, Moreau
from impactlaw.errors import ImpactLawError
from impactlaw.models import load
from impactlaw.scene import scene_law

RK4, EULER = int(mujoco.mjtIntegrator.mjINT_RK4), int(mujoco.mjtIntegrator.mjINT_EULER)
Graphs = tuple[CompletedGraph, CompletedGraph]
"""Of positions, and of positions and velocities."""
EXACT = 0.0
"""Expected order of a method that makes no error but rounding and the tolerance of gaps."""
TUNED = "MuJoCo tuned"
"""Family of MuJoCo's soft contacts tuned to the restitution."""
LOCATED = "rigid located RK4"
"""The method whose error is compared with MuJoCo's."""


@dataclass(frozen=True)
class Scene:
    """A scene with its law, its reference, and what is known about the orders of methods on it.

    Attributes:
        name: for tables.
        model: name of the scene in models/.
        law: from the model to the law.
        duration: s.
        reference: from duration and tolerance to the pieces of the reference trajectory.
        restitution: what MuJoCo's contacts are tuned to.
        smooth_order: of RK4 with located impacts between impacts, `EXACT` where it integrates the flight exactly.
        euler_order: the same of Euler. MuJoCo's is semi-implicit: its positions are those of the leapfrog scheme, of
            order two, where no force acts at the start and at the impacts, as in the cradle.
        coarsest: timestep from which on orders are measured, s; where impacts accumulate it takes smaller ones.
        smallest: timestep of MuJoCo's tuned contacts, s; so small that they run as long as the rigid runs.
    """

    name: str
    model: str
    law: Callable[[mujoco.MjModel], Law]
    duration: float
    reference: Callable[[float, float], list[Arc]]
    restitution: float | dict[str, float]
    smooth_order: float
    euler_order: float = 1.0
    coarsest: float = 0.032
    smallest: float = 1e-4


SCENES = {
    scene.name: scene
    for scene in (
        Scene("bouncing ball", "bouncing_ball", scene_law, 1.2, references.bouncing_ball, 0.5, EXACT, smallest=1e-5),
        Scene(
            "cradle, reversal",
            "newtons_cradle",
            lambda _: Fremond.reversal(),
            2.5,
            references.cradle_reversal,
            1.0,
            4.0,
            2.0,
            smallest=1e-5,
        ),
        Scene(
            "cradle, Moreau",
            "newtons_cradle",
            lambda _: Moreau(1.0),
            2.5,
            references.cradle_moreau,
            1.0,
            4.0,
            2.0,
            smallest=1e-5,
        ),
        Scene("falling rod", "falling_rod", scene_law, 3.0, references.falling_rod, {"left": 1.0, "right": 0.0}, 2.0),
        Scene(
            "rocking block",
            "rocking_block",
            scene_law,
            0.7,
            references.rocking_block,
            0.0,
            2.0,
            coarsest=4e-3,
            smallest=1e-5,
        ),
        Scene("billiard break", "billiard_rack", scene_law, 0.8, references.billiard_break, 0.95, EXACT, EXACT),
    )
}


@dataclass(frozen=True)
class Method:
    """A way to step a scene.

    Attributes:
        name: for tables.
        family: lines of one family become one line of the picture, its lower envelope.
        simulate: from scene, model at its timestep, start and number of steps to the trajectory.
        integrator: MuJoCo's.
        order: expected, of a scene.
    """

    name: str
    family: str
    simulate: Callable[[Scene, mujoco.MjModel, mujoco.MjData, int], Trajectory]
    integrator: int
    order: Callable[[Scene], float]


def _with_law(contact_model: str) -> Callable[[Scene, mujoco.MjModel, mujoco.MjData, int], Trajectory]:
    return lambda scene, model, start, steps: rigid(model, start, scene.law(model), steps, contact_model=contact_model)


def _time_stepping(scene: Scene, model: mujoco.MjModel, start: mujoco.MjData, steps: int) -> Trajectory:
    return time_stepping(model, start, scene.law(model), steps)


def _default(timeconst: float | None) -> Callable[[Scene, mujoco.MjModel, mujoco.MjData, int], Trajectory]:
    def simulate(scene: Scene, model: mujoco.MjModel, start: mujoco.MjData, steps: int) -> Trajectory:
        if timeconst is not None:
            model.geom_solref[:, 0] = timeconst
        return soft(model, start, steps)

    return simulate


def _tuned(steps_in_contact: float) -> Callable[[Scene, mujoco.MjModel, mujoco.MjData, int], Trajectory]:
    return lambda scene, model, start, steps: soft(tuned(model, scene.restitution, steps_in_contact), start, steps)


def _methods() -> Iterator[Method]:
    integrators = (("RK4", RK4), ("Euler", EULER))
    for name, integrator in integrators:
        yield Method(
            f"rigid located {name}",
            f"rigid located {name}",
            _with_law("rigid"),
            integrator,
            (lambda scene: scene.smooth_order) if integrator == RK4 else (lambda scene: scene.euler_order),
        )
    yield Method("rigid time stepping", "rigid time stepping", _time_stepping, EULER, lambda _: 1.0)
    for name, integrator in integrators:
        yield Method(f"soft layer {name}", "soft layer", _with_law("soft"), integrator, lambda _: np.nan)
    for name, integrator in integrators:
        yield Method(f"MuJoCo default {name}", "MuJoCo default", _default(None), integrator, lambda _: 0.0)
        for constant in (5e-3, 1e-3):
            yield Method(
                f"MuJoCo timeconst {constant:g} {name}", "MuJoCo default", _default(constant), integrator, lambda _: 0.0
            )
        for steps in (10, 30, 100, 300):
            yield Method(f"MuJoCo tuned {steps} {name}", TUNED, _tuned(steps), integrator, lambda _: np.nan)


METHODS = {method.name: method for method in _methods()}


@dataclass(frozen=True, kw_only=True)
class SteppingStudy:
    """Which scenes to step, and how finely.

    Attributes:
        scenes: names from `SCENES`.
        timesteps: s, of every method.
        methods: names from `METHODS`.
        finest: MuJoCo's tuned contacts get timesteps down to this one, or to the scene's smallest if that is larger, s.
    """

    scenes: tuple[str, ...] = tuple(SCENES)
    timesteps: tuple[float, ...] = tuple(10 ** (-1 - k / 2) for k in range(7))
    methods: tuple[str, ...] = tuple(METHODS)
    finest: float = 0.0


def cells(study: SteppingStudy) -> Iterator[tuple[Scene, Method, float]]:
    """Yield every scene, method and timestep of the study."""
    for scene in (SCENES[name] for name in study.scenes):
        for method in (METHODS[name] for name in study.methods):
            yield from ((scene, method, timestep) for timestep in study.timesteps)
            if method.family == TUNED:
                timestep = study.timesteps[-1] / np.sqrt(10)
                while timestep > 0.9 * max(scene.smallest, study.finest):
                    yield scene, method, timestep
                    timestep /= np.sqrt(10)


def run(study: SteppingStudy, progress: Callable[[str], object] = lambda _: None) -> pd.DataFrame:
    """Return one row per scene, method and timestep.

    Columns: scene; method; family; timestep, s (rounded so that it divides the duration); steps; seconds of
    processor time of the whole simulation; error, the largest scaled distance of a state from the reference's graph in
    (t, q) (see `graph_distance`); error_qv, the same in (t, q, v); expected order; reference_error, that of the
    reference itself; refused, why the simulation was.
    """
    graphs: dict[str, tuple[Graphs, float]] = {}
    rows = []
    for scene, method, timestep in cells(study):
        progress(f"{scene.name}, {method.name}, {timestep:.0e} s")
        if scene.name not in graphs:
            graphs[scene.name] = reference_graph(scene)
        of_scene, uncertainty = graphs[scene.name]
        rows.append(_row(scene, method, timestep, of_scene) | {"reference_error": uncertainty})
    return pd.DataFrame(rows)


def reference_graph(scene: Scene) -> tuple[Graphs, float]:
    """Return the graphs of the reference, and its distance from a reference with ten times the tolerance."""
    arcs = scene.reference(scene.duration, 1e-13)
    graphs = CompletedGraph(arcs, velocities=False), CompletedGraph(arcs)
    coarser = scene.reference(scene.duration, 1e-12)
    points = np.vstack([arc.points(np.linspace(arc.begin, arc.end, 100)) for arc in coarser])
    return graphs, float(graphs[1].distance(points).max())


def _row(scene: Scene, method: Method, timestep: float, graphs: Graphs) -> dict[str, object]:
    model, start = load(scene.model)
    steps = max(1, round(scene.duration / timestep))
    model.opt.timestep, model.opt.integrator = scene.duration / steps, method.integrator
    row: dict[str, object] = {
        "scene": scene.name,
        "method": method.name,
        "family": method.family,
        "timestep": model.opt.timestep,
        "steps": steps,
        "seconds": np.nan,
        "error": np.nan,
        "error_qv": np.nan,
        "expected_order": method.order(scene),
        "refused": "",
    }
    try:
        trajectory = method.simulate(scene, model, start, steps)
    except ImpactLawError as error:
        return row | {"refused": str(error)}
    finite = np.isfinite(trajectory.points).all()
    errors = [float(graph.distance(trajectory.points).max()) if finite else np.inf for graph in graphs]
    return row | {"seconds": trajectory.seconds, "error": errors[0], "error_qv": errors[1]}
