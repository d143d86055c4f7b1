"""Shapes under time stepping: meshes, height fields, round bodies, and fast bodies that must not tunnel."""

import math

import pytest
from scenes import compiled, run
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import MaximalDissipation, Moreau, Newton

G = 9.81


def dropped(world, rest="", seconds=1.0, **options):
    model, data = compiled(world, rest, **options)
    stepper = stepping(model, Moreau(0.0))
    run(stepper, data, round(seconds / model.opt.timestep))
    return model, data, stepper


CUBE = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))


def test_a_mesh_falls_on_a_mesh_and_rests():
    rest = f'<asset><mesh name="cube" vertex="{CUBE}"/></asset>'
    world = '<geom type="mesh" mesh="cube"/><body pos="0 0 .23"><freejoint/><geom type="mesh" mesh="cube"/></body>'
    _, data, _ = dropped(world, rest)
    assert data.qpos[2] == pytest.approx(0.2, abs=1e-6)
    assert abs(data.qvel).max() < 1e-6


def test_a_ball_and_a_box_rest_on_a_height_field():
    rest = '<asset><hfield name="flat" nrow="20" ncol="20" size="2 2 .5 .1"/></asset>'
    world = """<geom type="hfield" hfield="flat"/><body pos="0.03 0.02 .13"><freejoint/><geom size=".1"/></body>
        <body pos="0.61 0.53 .13"><freejoint/><geom type="box" size=".1 .1 .1"/></body>"""
    _, data, _ = dropped(world, rest)
    assert data.qpos[[2, 9]] == pytest.approx([0.1, 0.1], abs=1e-5)
    assert abs(data.qvel).max() < 1e-3


@pytest.mark.parametrize("shape", ['type="ellipsoid" size=".2 .15 .1"', 'type="cylinder" size=".15 .1"',
                                   'type="capsule" size=".1 .2" euler="90 0 0"'])  # fmt: skip
def test_round_shapes_fall_and_rest(shape):
    _, data, _ = dropped(FLOOR + f'<body pos="0 0 .13"><freejoint/><geom {shape}/></body>')
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-6)
    assert abs(data.qvel).max() < 1e-3


def test_a_cylinder_rolls_as_far_as_it_should():
    """For a solid cylinder that sticks, a = 2/3 g sin(angle)."""
    angle = 0.2
    world = FLOOR + '<body pos="0 0 .1" euler="90 0 0"><freejoint/><geom type="cylinder" size=".1 .3" mass="1"/></body>'
    option = f'gravity="{G * math.sin(angle)} 0 {-G * math.cos(angle)}" timestep="1e-3"'
    _, data, _ = dropped(world, option=option, geom='condim="3" friction="1"')
    assert data.qvel[0] == pytest.approx(2 / 3 * G * math.sin(angle), rel=1e-3)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("law", [MaximalDissipation(), Newton(0.5)])
@pytest.mark.parametrize("speed", [10.0, 100.0, 300.0])
def test_a_fast_ball_does_not_pass_through_a_thin_plate(law, speed):
    world = """<geom name="plate" type="box" size=".0005 1 1"/>
        <body pos="-1.013 0 0"><freejoint/><geom size=".01" mass="1"/></body>"""
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"', geom='condim="1"')
    data.qvel[0] = speed
    stepper = stepping(model, law)
    events = run(stepper, data, round(1.5 / speed / 0.002) + 5)
    assert len(events) == 1
    assert data.qpos[0] < 0
    e = 0.5 if isinstance(law, Newton) else 0.0
    assert data.qvel[0] == pytest.approx(-e * speed, abs=1e-7)


def test_two_fast_balls_do_not_pass_through_each_other():
    world = "".join(f'<body pos="{x} 0 0"><freejoint/><geom size=".01" mass="1"/></body>' for x in (-1.003, 1.0))
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"', geom='condim="1"')
    data.qvel[[0, 6]] = 100.0, -100.0
    events = run(stepping(model, Newton(0.5)), data, 10)
    assert len(events) == 1
    assert data.qvel[[0, 6]] == pytest.approx([-50, 50], abs=1e-7)


def test_a_fast_rod_that_turns_does_not_pass_through_a_pin():
    world = """<geom type="capsule" fromto=".8 0 -1 .8 0 1" size=".005"/>
        <body euler="0 0 -60"><joint axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 1 0 0" size=".005" mass="1"/></body>"""
    model, data = compiled(world, option='timestep="2e-3" gravity="0 0 0"', geom='condim="1"')
    data.qvel[0] = 100.0
    (event,) = run(stepping(model, Newton(0.5)), data, 8)
    assert event.impact.post_velocity == pytest.approx([-50], abs=1e-6)
    assert data.qpos[0] < math.radians(60)
