"""Exact outcomes from textbooks and papers, in every way to step."""

import numpy as np
import pytest
from scenes import compiled
from scipy.integrate import quad

from impactlaw import Coulomb, Moreau, Newton, Stepper

G = 9.81
JOINTS = ("slide", "1 0 0"), ("slide", "0 0 1"), ("hinge", "0 1 0")
RIGID = {"event-driven": {}, "time-stepping": {"scheme": "time-stepping"}}
EVERY = {**RIGID, "soft": {"contact_model": "soft"}}


@pytest.mark.parametrize("way", RIGID)
@pytest.mark.parametrize(("ratio", "collisions"), [(1, 3), (100, 31)])
def test_balls_and_a_wall_count_digits_of_pi(way, ratio, collisions):
    """G. Galperin, Playing pool with pi, 2003: the number of elastic collisions."""
    wall = '<geom type="plane" size="9 9 1" euler="0 90 0"/>'
    ball = '<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="{mass}"/></body>'
    world = wall + ball.format(x=1.1, mass=1) + ball.format(x=3, mass=ratio)
    model, data = compiled(world, option='timestep="0.01" gravity="0 0 0"', geom='condim="1"')
    data.qvel[1] = -1.0
    stepper = Stepper(model, Moreau(1.0), **RIGID[way])
    count = 0
    for _ in range(600):
        stepper.step(data)
        count += len(stepper.events)
    assert count == collisions
    assert data.qvel[0] ** 2 + ratio * data.qvel[1] ** 2 == pytest.approx(ratio, rel=1e-9)


@pytest.mark.parametrize(("way", "tolerance"), [("event-driven", 1e-4), ("time-stepping", 1e-4), ("soft", 2e-3)])
def test_a_ladder_leaves_the_wall_at_two_thirds_of_its_height(way, tolerance):
    """A rod of 1 m slides down without friction from 70 degrees; its horizontal speed there is kept, m/s."""
    start, r = np.radians(70.0), 1e-3
    x, z = 0.5 * np.cos(start), 0.5 * np.sin(start)
    joints = "".join(f'<joint type="{kind}" axis="{axis}"/>' for kind, axis in JOINTS)
    ends = f'<geom size="{r}" pos="{x} 0 {-z}" mass="0"/><geom size="{r}" pos="{-x} 0 {z}" mass="0"/>'
    rod = f'<inertial pos="0 0 0" mass="1" diaginertia="1 {1 / 12} 1"/>{ends}'
    planes = '<geom type="plane" size="9 9 1"/><geom type="plane" size="9 9 1" euler="0 90 0"/>'
    world = f'{planes}<body pos="{x + r} 0 {z + r}">{joints}{rod}</body>'
    model, data = compiled(world, option='integrator="RK4"', geom='condim="1"')
    end = np.arcsin(2 / 3 * np.sin(start))
    leaves, _ = quad(lambda a: (3 * G * (np.sin(start) - np.sin(a)) + 1e-15) ** -0.5, end, start)
    stepper = Stepper(model, Newton(0.0), **EVERY[way])
    while data.time < leaves + 0.05:
        stepper.step(data)
    expected = 0.5 * np.sin(end) * np.sqrt(3 * G * (np.sin(start) - np.sin(end)))
    assert data.qvel[0] == pytest.approx(expected, abs=tolerance)
    assert data.qpos[0] - r > 1e-3 + 0.5 * np.cos(start)


@pytest.mark.parametrize(("way", "tolerance"), [("event-driven", 1.5e-3), ("time-stepping", 8e-4), ("soft", 8e-3)])
@pytest.mark.parametrize("table", ["heavy", "belt"])
def test_a_ball_on_a_turntable_circles_with_two_sevenths_of_its_speed(way, table, tolerance):
    """It rolls in a circle whose centre need not be that of the table (Weltner, Am. J. Phys. 47, 1979)."""
    speed, radius, seconds = 4.0, 0.05, 2.0
    run = f'surfacevel="0 0 0 0 0 {speed}"' if table == "belt" else ""
    hinge = '<joint axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1e7 1e7 1e7"/>' if not run else ""
    disk = f'<body>{hinge}<geom type="cylinder" size="2 .1" pos="0 0 -.1" mass="0" {run}/></body>'
    ball = f'<body pos=".5 0 {radius}"><freejoint/><geom size="{radius}" mass="1"/></body>'
    option = 'timestep="0.002" integrator="RK4" cone="elliptic" impratio="50"'
    model, data = compiled(disk + ball, option=option, geom='friction="0.9"')
    v = np.array([0.1, 0.2])  # of the ball, whose lowest point moves with the table
    data.qvel[-6:] = [*v, 0, (speed * 0.5 - v[1]) / radius, v[0] / radius, 0]
    if not run:
        data.qvel[0] = speed
    stepper = Stepper(model, Newton(0.0), **EVERY[way])
    for _ in range(round(seconds / model.opt.timestep)):
        stepper.step(data)
    k = 2 / 7 * speed
    start = np.array([v[1], -v[0]]) / k  # from the centre of the circle
    c, s = np.cos(k * seconds), np.sin(k * seconds)
    expected = np.array([0.5, 0.0]) - start + np.array([[c, -s], [s, c]]) @ start
    np.testing.assert_allclose(data.qpos[-7:-5], expected, atol=tolerance)


def rope(beads, mu, pull):
    """Return a scene: 1 kg and ``pull`` kg on a light rope of beads over a drum."""
    r, turn = 0.5, np.pi / beads
    place = [(-r * np.cos(turn * k), r * np.sin(turn * k)) for k in range(beads + 1)]
    place = [(-r, -0.5), *place, (r, -0.5)]
    world, before = "", (0.0, 0.0)
    for k, (x, z) in enumerate(place):
        mass = {0: 1.0, beads + 2: pull}.get(k, 0.02)
        joints = "".join(f'<joint type="{kind}" axis="{axis}"/>' for kind, axis in JOINTS[0 if k == 0 else 2 :])
        world += f"""<body pos="{x - before[0]} 0 {z - before[1]}" gravcomp="{float(mass == 0.02)}">{joints}
          <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-7 1e-7 1e-7"/>
          <geom size="1e-4" contype="1" conaffinity="2"/>"""
        before = x, z
    drum = f'<geom type="cylinder" size="{r - 1e-4} 1" euler="90 0 0" contype="2" conaffinity="1"/>'
    option = 'timestep="2e-3" integrator="RK4"'
    return compiled(drum + world + "</body>" * len(place), option=option, geom=f'friction="{mu} 0 0"')


@pytest.mark.parametrize(("way", "options"), [("event-driven", {"overlap": "push-out"}), ("time-stepping", {})])
def test_a_rope_around_a_drum_holds_what_eytelwein_says(way, options):
    """A continuous rope holds exp(mu pi) times as much; one with n corners of ``a = pi / n`` holds the value below."""
    beads, mu = 6, 0.3
    tangent = mu * np.tan(np.pi / beads / 2)
    holds = ((1 + tangent) / (1 - tangent)) ** beads
    assert holds == pytest.approx(np.exp(mu * np.pi), rel=0.03)
    rises = []
    for part in (0.998, 1.002):
        model, data = rope(beads, mu, part * holds)
        stepper = Stepper(model, Moreau(0.0), **RIGID[way], **options)
        for _ in range(10):
            stepper.step(data)
        rises.append(data.qvel[1])
    assert abs(rises[0]) < 1e-6 < 1e-4 < rises[1]


@pytest.mark.parametrize("way", RIGID)
@pytest.mark.parametrize("mu", [9.0, 0.3])
def test_a_superball_comes_back_from_under_a_table(way, mu):
    """R. L. Garwin, Kinematics of an ultraelastic rough ball, 1969: three bounces, on floor, table and floor."""
    r, speed, spin = 0.03, np.array([2.0, -3.0]), 5.0
    planes = '<geom type="plane" size="9 9 1"/><geom type="plane" size="9 9 1" pos="0 0 .5" zaxis="0 0 -1"/>'
    ball = f'<body pos="0 0 .1"><freejoint/><geom size="{r}" mass="1"/></body>'
    model, data = compiled(planes + ball, option='gravity="0 0 0"', geom=f'friction="{mu} 0 0"')
    data.qvel[[0, 2, 4]] = *speed, spin
    stepper = Stepper(model, Coulomb(Newton(1.0), tangential_restitution=1.0), **RIGID[way])
    for side in (1, -1, 1):
        push = 2 * abs(speed[1])
        rub = np.clip(-2 * (speed[0] - side * r * spin) / 3.5, -mu * push, mu * push)
        speed, spin = speed + np.array([rub, side * push]), spin - side * rub / (0.4 * r)
        stepper.step(data)
        while not stepper.events:
            stepper.step(data)
        np.testing.assert_allclose(data.qvel[[0, 2, 4]], [*speed, spin], rtol=1e-6)
