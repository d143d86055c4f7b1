"""The references of the work-precision study, and the distance of the steppers from them."""

from itertools import pairwise

import numpy as np
import pytest

from scripts.work_precision import references, references_friction, scenes_friction
from scripts.work_precision.graph_distance import CompletedGraph
from scripts.work_precision.scenes import SCENES
from scripts.work_precision.stepping import EULER, RK4
from scripts.work_precision.trajectories import rigid

REFERENCES = {name: (scene.reference, scene.duration) for name, scene in SCENES.items()}


@pytest.mark.parametrize("scene", REFERENCES)
def test_references_are_continuous_in_position_and_their_velocities_are_derivatives(scene):
    reference, duration = REFERENCES[scene]
    arcs = reference(duration, 1e-12)
    assert arcs[0].begin == 0.0
    assert arcs[-1].end == pytest.approx(duration)
    for before, after in pairwise(arcs):
        assert before.end == after.begin
        q, p = before.state(np.array([before.end]))[0], after.state(np.array([after.begin]))[0]
        nv = len(q) // 2
        assert q[:nv] == pytest.approx(p[:nv], abs=1e-10)
    for arc in arcs:
        t = np.linspace(arc.begin, arc.end, 20)[1:-1]
        small = 1e-5 * (arc.end - arc.begin)
        if small > 0:
            slope = (arc.state(t + small) - arc.state(t - small)) / (2 * small)
            assert slope[:, :nv] == pytest.approx(arc.state(t)[:, nv:], abs=1e-6)


def test_references_repeat_the_numbers_in_the_comments_of_the_scenes():
    ball = references.bouncing_ball(1.2, 0.0)
    assert [arc.end for arc in ball[:3]] == pytest.approx([0.4515236, 2 * 0.4515236, 2.5 * 0.4515236], abs=1e-6)
    block = references.rocking_block(0.7, 1e-12)
    assert abs(block[0].state(np.array([block[0].end]))[0, 3]) == pytest.approx(1.483425, abs=1e-6)
    rod = references.falling_rod(3.0, 1e-12)
    swing = rod[1].state(np.linspace(rod[1].begin, rod[1].end, 1001))
    assert swing[:, 0].max() == pytest.approx(1 / 6, abs=1e-5)
    cradle = references.cradle_reversal(2.5, 0.0)
    swing = cradle[1].state(np.linspace(0.0, cradle[1].end, 1001))
    assert np.degrees(swing[:, 4].max()) == pytest.approx(18.4, abs=0.05)


def test_references_with_friction_repeat_what_the_docstrings_say():
    block = references_friction.sliding_block(0.5, 0.0)
    assert block[-1].points(np.array([0.5]))[0, 1] == pytest.approx(1.0 / (2 * 0.3 * 9.81))
    fall, right, sticks, left, rest = references_friction.rod(0.6, 1e-12)
    assert fall.end == pytest.approx(np.sqrt(2 * (0.4 - 0.5 * np.sin(0.6)) / 9.81))
    for arc, way in ((right, 1), (sticks, 0), (left, -1)):
        _, z, q, u, _, spin = arc.state(np.linspace(arc.begin, arc.end, 20)[1:-1]).T
        assert z - 0.5 * np.sin(q) == pytest.approx(np.zeros(18), abs=1e-10)
        tip = u - spin * (0.5 * np.sin(q) + scenes_friction.TIP)
        assert (np.sign(tip) == way).all() if way else (np.abs(tip) < 1e-10).all()
    assert rest.state(np.array([0.6]))[0] == pytest.approx(rest.state(np.array([0.4]))[0], abs=0)


@pytest.mark.parametrize(
    ("scene", "way", "furthest"),
    [
        ("rod with friction", "event-driven", 1e-5),
        ("rod with friction", "time-stepping", 1e-2),
        ("quadruped", "event-driven", 0.1),
        ("quadruped", "time-stepping", 0.03),
    ],
)
def test_steppers_come_near_the_references_with_friction_which_are_computed_without_them(scene, way, furthest):
    known = SCENES[scene]
    model, start = known.load()
    model.opt.timestep, model.opt.integrator = 5e-4, RK4 if way == "event-driven" else EULER
    steps = round(known.duration / 5e-4)
    points = rigid(model, start, known.law(model), steps, way=way, repeat=False).points
    graph = CompletedGraph(known.reference(known.duration, 1e-12), velocities=False)
    assert graph.distance(points).max() < furthest
