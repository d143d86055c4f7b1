"""Moving surfaces: mocap bodies that carry, hit, swing and jump in velocity; exact answers in rigid stepping."""

import math
from functools import partial

import mujoco
import numpy as np
import pytest
import scenes

from impactlaw import MaximalDissipation, Moreau, Newton, Stepper

G = 9.81
TABLE = '<body name="table" mocap="true"><geom name="table" type="box" size="1 1 .1" pos="0 0 -.1"/></body>'


compiled = partial(scenes.compiled, option='timestep="0.01" integrator="RK4"', geom='condim="1"')


def ball(name="ball", height=1.0, mass=1.0):
    return (
        f'<body name="{name}" pos="0 0 {height}"><joint type="slide" axis="0 0 1"/>'
        f'<geom name="{name}" size=".1" mass="{mass}"/></body>'
    )


def drive(stepper, data, steps, path):
    """Move the table along a path of heights, and return the collisions."""
    events = []
    h = stepper.model.opt.timestep
    for _ in range(steps):
        data.mocap_pos[0, 2] = path(data.time + h)
        stepper.step(data)
        assert data.mocap_pos[0, 2] == path(data.time)
        events += stepper.events
    return events


@pytest.mark.parametrize("integrator", ["RK4", "Euler"])
@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_a_table_that_rises_at_constant_speed(e, integrator):
    """In its frame the ball bounces on a table at rest, from 0.9 m with velocity -u: exact with RK4."""
    u = 0.5
    model, data = compiled(TABLE + ball(), option=f'timestep="0.01" integrator="{integrator}"')
    stepper = Stepper(model, Newton(e))
    drive(stepper, data, 1, lambda t: 0.0)
    start = data.time
    drop, speed = data.qpos[0] + 0.9, data.qvel[0] - u
    events = drive(stepper, data, 70, lambda t: max(u * (t - start), 0.0))
    arrival = (speed + math.sqrt(speed**2 + 2 * G * drop)) / G
    hit = -math.sqrt(speed**2 + 2 * G * drop)
    tolerance = 1e-9 if integrator == "RK4" else 0.5 * G * 0.01
    assert events[0].time == pytest.approx(start + arrival, abs=tolerance)
    impact = events[0].impact
    assert impact.collision.pre_contact_velocity == pytest.approx([hit], abs=tolerance)
    assert impact.post_velocity == pytest.approx([u - e * impact.collision.pre_contact_velocity[0]])
    assert impact.surface_work == pytest.approx(impact.impulse[0] * u)
    assert impact.violations.is_admissible()
    rest = start + arrival
    if e:
        again = rest + 2 * e * -hit / G
        assert events[1].time == pytest.approx(again, abs=tolerance) if again < data.time else len(events) == 1
    else:
        assert len(events) == 1
        assert data.qpos[0] + 0.9 == pytest.approx(data.mocap_pos[0, 2], abs=1e-9)
        assert data.qvel[0] == pytest.approx(u, abs=1e-9)


def bounces(timestep, periods=4):
    """Return the largest error of impact times and velocities of a ball that bounces in phase with a table."""
    e, omega, A = 0.5, 4 * np.pi, 0.08
    period = 2 * np.pi / omega
    up = 0.5 * G * period
    phase = math.acos(up * (1 - e) / (1 + e) / (A * omega))

    def path(t):
        return A * math.sin(omega * t + phase)

    model, data = compiled(TABLE + ball(height=0.1), option=f'timestep="{timestep}" integrator="RK4"')
    stepper = Stepper(model, Newton(e))
    data.qpos[0], data.time = 1.0, -5 * timestep
    drive(stepper, data, 5, path)  # the ball is far away while the table reaches its velocity
    data.qpos[0], data.qvel[0] = path(data.time) + up * data.time, up - G * data.time
    events = drive(stepper, data, round((periods + 0.1) * period / timestep), path)
    assert len(events) == periods
    times = np.array([event.time for event in events]) - period * np.arange(1, periods + 1)
    speeds = np.array([event.impact.post_velocity[0] for event in events]) - up
    return max(np.abs(times).max() * G, np.abs(speeds).max())


def test_a_ball_bounces_with_the_period_of_an_oscillating_table():
    """v+ = g T / 2 where the table moves with g T (1 - e) / (2 (1 + e)); its path of chords is of second order."""
    coarse, fine = bounces(0.005), bounces(0.0025)
    print(coarse, fine)
    assert fine < 2e-3
    assert 3.0 < coarse / fine < 5.0


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
def test_a_ball_at_rest_goes_along_with_the_table(integrator):
    """Accelerations stay below g: no collisions, and the gap stays closed."""
    model, data = compiled(TABLE + ball(height=0.1), option=f'timestep="0.005" integrator="{integrator}"')
    stepper = Stepper(model, Newton(0.8))
    drive(stepper, data, 1, lambda t: 0.0)
    for _ in range(400):
        assert drive(stepper, data, 1, lambda t: 0.05 * (1 - math.cos(10 * (t - 0.005)))) == []
        assert data.qpos[0] == pytest.approx(data.mocap_pos[0, 2], abs=1e-9)


def test_a_ball_leaves_a_table_that_falls_faster_than_it():
    model, data = compiled(TABLE + ball(height=0.1))
    stepper = Stepper(model, MaximalDissipation())
    drive(stepper, data, 2, lambda t: 0.0)
    start = data.time
    drive(stepper, data, 20, lambda t: -0.5 * 15.0 * (t - start) ** 2)
    assert data.qpos[0] == pytest.approx(-0.5 * G * 0.2**2, abs=1e-12)


@pytest.mark.parametrize("law", [MaximalDissipation(), Moreau(1.0), Newton(0.5)])
def test_a_hammer_blow_under_a_stack(law):
    """The table jumps to 2 m/s, a collision with w- = 0 and w+ = -2 m/s: the stack moves with it."""
    stack = ball("low", 0.1, 1.0) + ball("middle", 0.3, 2.0) + ball("high", 0.5, 3.0)
    model, data = compiled(TABLE + stack, option='timestep="0.01" gravity="0 0 -9.81" integrator="RK4"')
    stepper = Stepper(model, law)
    assert drive(stepper, data, 3, lambda t: 0.0) == []
    start = data.time
    (event,) = drive(stepper, data, 1, lambda t: 2.0 * (t - start))
    assert event.time == pytest.approx(start)
    c, impact = event.impact.collision, event.impact
    np.testing.assert_allclose(c.surface_velocity, 0.0, atol=1e-12)
    np.testing.assert_allclose(
        c.post_surface_velocity, [0.0, 0.0, -2.0][::-1] if c.labels[0] != "table/low" else [-2, 0, 0]
    )
    np.testing.assert_allclose(impact.post_velocity, 2.0, rtol=1e-12)
    assert impact.surface_work == pytest.approx(0.5 * 6.0 * 2.0**2)
    assert impact.violations.is_admissible()
    np.testing.assert_allclose(data.qpos, 0.02, atol=1e-9)  # they move with the table


def test_what_separates_when_the_table_jumps_is_hit_by_it():
    """A ball leaves the table at 1 m/s and the table follows at 3: gamma- = -2, not the end of a rest."""
    model, data = compiled(TABLE + ball(height=0.1), option='timestep="0.01" gravity="0 0 0"')
    stepper = Stepper(model, Newton(0.5))
    drive(stepper, data, 1, lambda t: 0.0)
    data.qvel[0] = 1.0
    start = data.time
    (event,) = drive(stepper, data, 1, lambda t: 3.0 * (t - start))
    assert event.impact.collision.pre_contact_velocity == pytest.approx([-2.0])
    assert event.impact.post_velocity == pytest.approx([3.0 + 0.5 * 2.0])


def test_a_swinging_bat():
    """A bat turns about its end at 5 rad/s and hits a ball 0.8 m away: v+ = (1 + e) omega r."""
    bat = '<body name="bat" mocap="true"><geom name="bat" type="capsule" fromto="0 0 0 1 0 0" size=".05"/></body>'
    struck = '<body name="ball" pos=".8 .25 0"><freejoint/><geom name="ball" size=".1" mass="2"/></body>'
    model, data = compiled(bat + struck, option='timestep="0.01" gravity="0 0 0"')
    stepper = Stepper(model, Newton(0.5))
    events = []
    for k in range(8):
        angle = 5.0 * 0.01 * k
        data.mocap_quat[0] = math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)
        stepper.step(data)
        events += stepper.events
    (event,) = events
    angle = math.atan2(0.25, 0.8) - math.asin(0.15 / math.hypot(0.25, 0.8))  # the line at a distance of 0.15 m
    assert event.time == pytest.approx(angle / 5.0 + 0.01, abs=1e-9)
    reach = math.sqrt(0.25**2 + 0.8**2 - 0.15**2)
    assert np.linalg.norm(event.impact.post_velocity[:3]) == pytest.approx(1.5 * 5.0 * reach, rel=1e-8)
    np.testing.assert_allclose(event.impact.post_velocity[3:], 0.0, atol=1e-9)


def test_a_fast_thin_plate_does_not_pass_through_a_ball():
    plate = '<body name="plate" mocap="true" pos="0 0 -5"><geom name="plate" type="box" size="1 1 .001"/></body>'
    model, data = compiled(plate + ball(height=0.0), option='timestep="0.01" gravity="0 0 0"')
    stepper = Stepper(model, Newton(1.0))
    events = drive(stepper, data, 12, lambda t: -5.0 + 100.0 * max(t - 0.01, 0.0))
    assert events[0].impact.post_velocity == pytest.approx([200.0])
    assert len(events) == 1


def test_a_body_put_somewhere_else_does_not_move_there():
    """After a reset, and before the first step, a new pose is a new place, not a motion."""
    model, data = compiled(TABLE + ball(height=0.3), option='timestep="0.01" gravity="0 0 0"')
    stepper = Stepper(model, Newton(1.0))
    data.mocap_pos[0, 2] = 0.15
    stepper.step(data)
    mujoco.mj_resetData(model, data)
    data.mocap_pos[0, 2] = 0.2
    stepper.step(data)
    assert stepper.events == ()
    assert data.qvel[0] == 0.0


def test_stepping_is_deterministic_after_a_reset():
    model, data = compiled(TABLE + ball(height=0.3))
    stepper = Stepper(model, Newton(0.7))
    ends = []
    for _ in range(2):
        mujoco.mj_resetData(model, data)
        drive(stepper, data, 60, lambda t: 0.05 * math.sin(20 * t))
        ends.append((data.qpos.copy(), data.qvel.copy()))
    np.testing.assert_array_equal(ends[0], ends[1])


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_box_with_friction_stays_on_a_table_that_swings_gently(integrator):
    """5 cm at 6 rad/s is less than 2 m/s^2: no body leaves the table, and no body collides with it."""
    world = """<body name="t" mocap="true"><geom type="box" size=".5 .5 .05" friction=".8"/></body>
        <body pos="0 0 .15"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" friction=".8"/></body>"""
    model, data = scenes.compiled(world, option=f'timestep="0.01" integrator="{integrator}"')
    stepper = Stepper(model, Moreau(0.0))
    collisions = 0
    stepper.step(data)
    for _ in range(60):
        data.mocap_pos[0, 2] = 0.05 * (1 - np.cos(6 * data.time))
        stepper.step(data)
        collisions += len(stepper.events)
        assert data.qpos[2] - data.mocap_pos[0, 2] == pytest.approx(0.15, abs=1e-8)
    assert collisions <= 1
