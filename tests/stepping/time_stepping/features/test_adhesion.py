"""Adhesion under time stepping, by actuators and of geoms."""

import pytest
from scenes import compiled, run
from stepping.time_stepping.stepped import stepping

from impactlaw import Moreau


@pytest.mark.parametrize(("force", "holds"), [(30.0, True), (15.0, False)])
def test_an_adhesion_actuator_holds_a_box_on_a_ceiling(force, holds):
    world = """<geom type="box" size="1 1 .1" pos="0 0 .1"/>
        <body name="b" pos="0 0 -.1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/></body>"""
    model, data = compiled(world, f'<actuator><adhesion body="b" ctrlrange="0 1" gain="{force}"/></actuator>')
    data.ctrl[0] = 1.0
    stepper = stepping(model, Moreau(0))
    run(stepper, data, 300)
    if holds:
        assert data.qpos[2] == pytest.approx(-0.1, abs=1e-6)
        assert abs(data.qvel).max() < 1e-6
    else:
        assert data.qpos[2] < -0.2


@pytest.mark.parametrize("away", [0.0, 0.002, 0.005])
def test_adhesion_of_geoms_holds_and_pulls_within_its_range(away):
    """Four contacts of 30 N against 19.6 N, in contact and across the range of 1 cm."""
    world = f"""<geom type="box" size="1 1 .1" pos="0 0 .1"/><body pos="0 0 {-0.1 - away}"><freejoint/>
        <geom type="box" size=".1 .1 .1" mass="2" adhesion="30" gap=".01"/></body>"""
    model, data = compiled(world)
    run(stepping(model, Moreau(0)), data, 300)
    assert data.qpos[2] == pytest.approx(-0.1, abs=1e-6)


def test_adhesion_presses_a_box_to_a_wall_by_friction():
    world = """<geom type="box" size=".1 1 1" pos="-.2 0 0"/>
        <body name="b"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>"""
    model, data = compiled(
        world, '<actuator><adhesion body="b" ctrlrange="0 1" gain="30"/></actuator>', geom='friction=".5"'
    )
    data.ctrl[0] = 1.0
    run(stepping(model, Moreau(0)), data, 300)
    assert data.qpos[:3] == pytest.approx([0, 0, 0], abs=1e-6)


@pytest.mark.parametrize(("away", "pulled"), [(0.018, True), (0.021, False), (0.035, False)])
def test_adhesion_reaches_as_far_as_the_gaps_of_both(away, pulled):
    world = f"""<geom type="box" size="1 1 .1" pos="0 0 .1" gap=".01" adhesion="15"/><body pos="0 0 {-0.1 - away}">
        <freejoint/><geom size=".1" mass="1" gap=".01" adhesion="15"/></body>"""
    model, data = compiled(world, option='gravity="0 0 0"')
    run(stepping(model, Moreau(0)), data, 10)
    assert (data.qvel[2] > 0.1) == pulled


def test_what_a_collision_throws_is_looked_for_though_another_geom_of_it_has_a_gap():
    """A ball is hit, and thrown at a wall within the step; only a pad of the ball that never touches has a `gap`."""
    world = """<body><joint type="slide" axis="1 0 0"/><geom name="a" size=".05" mass="1"/></body>
        <body name="b" pos=".12 0 0"><joint type="slide" axis="1 0 0"/><geom name="b" size=".05" mass="1"/>
          <geom size=".01" pos="0 0 .2" mass="0" gap="1" contype="0" conaffinity="0"/></body>
        <geom name="wall" type="plane" pos=".2 0 0" zaxis="-1 0 0" size="1 1 1"/>"""
    sticks = '<actuator><adhesion body="b" ctrlrange="0 1" gain="1"/></actuator>'
    model, data = compiled(world, sticks, option='gravity="0 0 0" timestep=".01"', geom='condim="1"')
    data.qvel[0] = 10.0
    stepper = stepping(model, Moreau(1.0))
    stepper.step(data)
    assert [event.contacts.labels for event in stepper.events] == [("a/b",), ("wall/b",), ("a/b",)]
    assert data.qpos[1] == pytest.approx(0.0, abs=1e-9)
