"""Errors of time stepping decrease with the timestep at the expected order."""

import math

import mujoco
import numpy as np
import pytest
from scenes import compiled, energy, run
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau, Newton

G = 9.81


def bounce(t, height, e):
    """Return the height of a ball some time after it is dropped from a height."""
    fall = math.sqrt(2 * height / G)
    if t < fall:
        return height - 0.5 * G * t * t
    start, speed = fall, e * G * fall
    while speed > 1e-9:
        flight = 2 * speed / G
        if t < start + flight:
            return speed * (t - start) - 0.5 * G * (t - start) ** 2
        start, speed = start + flight, e * speed
    return 0.0


def bouncing_error(timestep, e):
    """Return the mean error of the final height over initial heights: this averages the phases of impacts in a step."""
    errors = []
    ball = '<body><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    for height in np.linspace(0.3, 0.5, 30):
        model, data = compiled(FLOOR + ball, option=f'timestep="{timestep}"', geom='condim="1"')
        data.qpos[0] = 0.1 + height
        stepper = stepping(model, Newton(e))
        for _ in range(round(0.8 / timestep)):
            stepper.step(data)
        errors.append(abs(data.qpos[0] - 0.1 - bounce(data.time, height, e)))
    return float(np.mean(errors))


@pytest.mark.parametrize("e", [0.5, 0.8])
def test_the_bouncing_ball_is_of_first_order(e):
    timesteps = np.array([8e-3, 4e-3, 2e-3, 1e-3])
    errors = [bouncing_error(h, e) for h in timesteps]
    slope = np.polyfit(np.log(timesteps), np.log(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_smooth_motion_is_of_second_order(integrator):
    """A double pendulum without contact, against tiny steps of RK4."""
    world = """<body><joint axis="0 1 0"/><geom size=".05" pos="0 0 -.5" mass="1"/>
        <body pos="0 0 -.5"><joint axis="0 1 0"/><geom size=".05" pos="0 0 -.5" mass="1"/></body></body>"""

    def start(timestep, integrator):
        model, data = compiled(world, option=f'timestep="{timestep}" integrator="{integrator}"')
        data.qpos[:] = 1.0, 0.5
        return model, data

    model, exact = start(1e-4, "RK4")
    for _ in range(5000):
        mujoco.mj_step(model, exact)
    errors = []
    for timestep in (1e-2, 5e-3, 2.5e-3):
        model, data = start(timestep, integrator)
        stepper = stepping(model, Moreau(0))
        for _ in range(round(0.5 / timestep)):
            stepper.step(data)
        errors.append(abs(data.qpos - exact.qpos).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=0.2)


ARM = """<joint axis="0 1 0"/><geom size=".05" pos=".3 0 0" mass="1"/><site name="tip" pos=".3 0 0"/>"""
POINT = """<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><geom size=".05" mass="1"/>
    <site name="tip"/>"""


@pytest.mark.parametrize("inertia", ["of a tendon", "of its actuator"])
@pytest.mark.parametrize("body", [ARM, POINT])
def test_a_tendon_with_inertia_that_turns(body, inertia):
    """Its inertia depends on its direction, which causes inertial forces; against tiny steps of RK4."""
    tendon, actuator = (' armature=".5"', "") if inertia == "of a tendon" else ("", ' armature=".5"')
    rest = f"""<tendon><spatial name="t"{tendon}><site site="tip"/><site site="hook"/></spatial></tendon>
        <actuator><motor tendon="t"{actuator}/></actuator>"""

    def start(timestep):
        world = f'<site name="hook" pos="1 0 .3"/><body>{body}</body>'
        model, data = compiled(world, rest, option=f'timestep="{timestep}" integrator="RK4"')
        data.qvel[:] = 0.3
        return model, data

    model, exact = start(1e-4)
    for _ in range(5000):
        mujoco.mj_step(model, exact)
    model, data = start(2e-3)
    run(stepping(model, Moreau(0)), data, 250)
    assert data.qpos == pytest.approx(exact.qpos, abs=2e-4)
    assert data.qvel == pytest.approx(exact.qvel, abs=1e-3)


def test_a_ball_that_slides_over_a_hill_follows_it():
    """Contact held on a curved surface: no events, and the gap stays closed to second order."""
    gaps, kept = [], []
    for timestep in (8e-3, 4e-3, 2e-3):
        world = """<geom name="hill" size=".5" pos="0 0 -.6" condim="1"/>
            <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
            <geom name="ball" size=".1" mass="1" condim="1"/></body>"""
        model, data = compiled(world, option=f'timestep="{timestep}"')
        data.qvel[0] = 0.5
        before = energy(model, data)
        stepper = stepping(model, Moreau(0.5))
        for _ in range(round(0.4 / timestep)):
            stepper.step(data)
            assert stepper.events == ()
        gaps.append(abs(math.hypot(data.qpos[0], data.qpos[1] + 0.6) - 0.6))
        kept.append(abs(energy(model, data) - before))
    for values in (gaps, kept):
        assert values[2] < 0.4 * values[1] < 0.16 * values[0] or max(values) < 1e-7
