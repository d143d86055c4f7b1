"""Moving surfaces under time stepping: tables, belts, grippers."""

import math

import numpy as np
import pytest
from scenes import compiled
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau, Newton

G = 9.81
TABLE = '<body name="table" mocap="true"><geom name="table" type="box" size="1 1 .1" pos="0 0 -.1"/></body>'


def falling(z=1.1):
    return f'<body pos="0 0 {z}"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="1"/></body>'


def drive(stepper, data, path, steps):
    events = []
    for _ in range(steps):
        data.mocap_pos[0, 2] = path(data.time + stepper.model.opt.timestep)
        stepper.step(data)
        events += stepper.events
    return events


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_table_that_rises_adds_its_speed(e):
    """v+ = -e v- + (1 + e) w."""
    model, data = compiled(TABLE + falling(), geom='condim="1"')
    stepper = stepping(model, Newton(e))
    data.mocap_pos[0] = 0
    stepper.step(data)
    events, w = [], 0.8
    while not events:
        before = data.qvel[0]
        events = drive(stepper, data, lambda t: w * (t - 0.002), 1)
        assert data.time < 2
    assert data.qvel[0] == pytest.approx(-e * before + (1 + e) * w, abs=1e-9)
    assert events[0].impact.surface_work == pytest.approx(events[0].impact.impulse[0] * w, rel=1e-9)


def test_a_ball_rides_on_a_table():
    model, data = compiled(TABLE + falling(0.1), option='timestep="0.005"', geom='condim="1"')
    stepper = stepping(model, Newton(0.8))
    for _ in range(300):
        events = drive(stepper, data, lambda t: 0.05 * (1 - math.cos(10 * t)), 1)
        assert events == []
        assert data.qpos[0] == pytest.approx(data.mocap_pos[0, 2], abs=2e-4)  # the table reverses within a step


def test_a_fast_table_hits_what_it_would_pass_through():
    """Only the table moves: 50 m/s, 10 cm per step, against a ball of 2 cm at rest."""
    ball = '<body pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom size=".01" mass="1"/></body>'
    thin = '<body name="table" mocap="true"><geom type="box" size="1 1 .001"/></body>'
    model, data = compiled(thin + ball, option='gravity="0 0 0" timestep="2e-3"', geom='condim="1"')
    stepper = stepping(model, Newton(0.5))
    stepper.step(data)
    events = drive(stepper, data, lambda t: 50 * (t - 0.002), 30)
    assert len(events) >= 1
    assert data.qvel[0] == pytest.approx(75, abs=1e-6)
    assert data.qpos[0] + 1 > data.mocap_pos[0, 2]


@pytest.mark.parametrize("friction", [0.4, 0.7, 1.1])
@pytest.mark.parametrize("way", [1.4e-6, 2.8e-6, 4.2e-6])
def test_a_box_that_mocap_bodies_squeeze_is_not_thrown_out_between_them(friction, way):
    """Regression: it left at 50 to 290 m/s as soon as it had turned by 1e-6: then there is a way out, if just one."""
    world = "".join(
        f'<body mocap="true" pos="{x} 3e-5 .1"><geom type="box" size=".02 .1 .1"/></body>' for x in (-0.12, 0.12)
    )
    world += '<body pos="0 -5e-5 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>' + FLOOR
    model, data = compiled(world, geom=f'friction="{friction}"')
    stepper, fastest = stepping(model, Moreau(0)), 0.0
    stepper.step(data)
    for _ in range(100):
        data.mocap_pos[:, 0] += [way, -way]
        stepper.step(data)
        fastest = max(fastest, np.abs(data.qvel).max())
    assert fastest < 1.0
    assert stepper.short_steps > 50  # no velocity satisfies both sides


def test_a_mocap_gripper_that_closes_on_a_box_is_no_error_and_does_not_throw_it():
    world = "".join(
        f'<body name="{n}" mocap="true" pos="{x} 0 .1"><geom type="box" size=".02 .1 .1"/></body>'
        for n, x in (("left", -0.12), ("right", 0.12))
    )
    world += '<body name="b" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>' + FLOOR
    model, data = compiled(world, geom='friction="1"')
    stepper = stepping(model, Moreau(0))
    stepper.step(data)
    for _ in range(100):
        data.mocap_pos[:, 0] += [5e-6, -5e-6]
        stepper.step(data)
        assert data.qpos[:3] == pytest.approx([0, 0, 0.1], abs=5e-4)  # somewhere between the two
        assert np.linalg.norm(data.qvel[:3]) < math.sqrt(2 * G * 5e-4)  # a fall by the depth of the squeeze


@pytest.mark.parametrize("condim", [3, 4])
def test_a_belt_drags_a_box_to_its_own_speed(condim):
    belt = '<geom name="belt" type="box" size="9 1 .1" pos="0 0 -.1" surfacevel="1.5 0 0 0 0 0"/>'
    box = '<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/></body>'
    model, data = compiled(belt + box, geom=f'friction=".3" condim="{condim}"')
    stepper = stepping(model, Newton(0.5))
    duration = 1.5 / (0.3 * G)
    while data.time < 0.4 - 1e-9:
        stepper.step(data)
        assert data.qvel[0] == pytest.approx(0.3 * G * data.time, abs=1e-8)
    while data.time < 2 * duration:
        stepper.step(data)
    assert data.qvel[0] == pytest.approx(1.5, abs=1e-9)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-9)
