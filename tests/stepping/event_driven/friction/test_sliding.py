"""Sliding, sticking, rolling and bouncing in rigid stepping, against closed forms."""

import math

import mujoco
import numpy as np
import pytest
from scenes import run
from stepping.event_driven.friction.bodies import G, ball, box, compiled, floor, sloped

from impactlaw import Coulomb, MaximalDissipation, Newton, Stepper


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast", "discrete"])
@pytest.mark.parametrize("friction", ["coulomb", "convex"])
def test_a_box_sticks_to_an_incline_and_does_not_creep(integrator, friction):
    """tan(0.45) = 0.483 < 0.5, for 10 s."""
    model, data = compiled(floor() + box(), option=sloped(0.45, f'timestep="0.01" integrator="{integrator}"'))
    stepper = Stepper(model, Newton(0.5), friction=friction)
    assert run(stepper, data, 1000) == []
    assert data.qpos[:3] == pytest.approx([0.0, 0.0, 0.1], abs=1e-9)
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize(("integrator", "tolerance"), [("RK4", 1e-9), ("Euler", 5e-3)])
def test_a_box_slides_down_an_incline(integrator, tolerance):
    """tan(0.5) = 0.546 > 0.5: x = (sin - mu cos) g t^2 / 2; Euler has an error of G h t / 2, as without friction."""
    model, data = compiled(floor() + box(), option=sloped(0.5, f'timestep="0.005" integrator="{integrator}"'))
    stepper = Stepper(model, Newton(0.5))
    assert run(stepper, data, 200) == []
    a = G * (math.sin(0.5) - 0.5 * math.cos(0.5))
    assert data.qvel[0] == pytest.approx(a, abs=1e-9)
    assert data.qpos[0] == pytest.approx(0.5 * a, abs=tolerance)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-9)


@pytest.mark.parametrize("timestep", [0.01, 0.005, 0.0025])
def test_a_box_stops_at_the_right_distance(timestep):
    """v^2 / (2 mu g): only the step in which it stops has an error, at most mu g h^2 / 2."""
    model, data = compiled(floor() + box(), option=f'timestep="{timestep}" integrator="RK4"')
    data.qvel[:2] = 0.8, 0.6
    stepper = Stepper(model, Newton(0.5))
    run(stepper, data, round(0.5 / timestep))
    distance = 1.0 / (2 * 0.5 * G)
    assert data.qpos[:2] == pytest.approx([0.8 * distance, 0.6 * distance], abs=0.5 * 0.5 * G * timestep**2)
    rest = data.qpos.copy()
    run(stepper, data, 100)
    assert data.qpos == pytest.approx(rest, abs=1e-12)


def test_a_ball_slides_until_it_rolls():
    """With initial speed v and no spin, it rolls with 5 v / 7 after 2 v / (7 mu g)."""
    mu, v = 0.2, 1.0
    model, data = compiled(floor() + ball(mu=mu))
    data.qvel[0] = v
    stepper = Stepper(model, Newton(0.5))
    start = 2 * v / (7 * mu * G)
    run(stepper, data, 100)
    assert data.time > start
    assert data.qvel[0] == pytest.approx(5 * v / 7, abs=1e-6)
    assert data.qvel[4] * 0.1 == pytest.approx(5 * v / 7, abs=1e-6)
    slid = v * start - 0.5 * mu * G * start**2
    assert data.qpos[0] == pytest.approx(slid + 5 * v / 7 * (data.time - start), abs=mu * G * 0.005**2)


def test_rolling_resistance_stops_a_ball():
    """A moment m_r N opposes rolling: (7/5) m a = -m_r N / R, with the coefficient m_r in meters.

    In MuJoCo's elliptic cone rolling and sliding share N: the force F = m a slips, by m_r omega F / (mu^2 N).
    """
    model, data = compiled(floor(condim=6) + ball(mu=1.0, condim=6, more="0.001 0.002"))
    data.qvel[0], data.qvel[4] = 1.0, 10.0
    stepper = Stepper(model, Newton(0.5))
    run(stepper, data, 200)
    a = 5 / 7 * 0.002 / 0.1 * G
    slip = 0.002 * 10 * a / G
    assert data.qvel[0] == pytest.approx(1.0 - a * data.time, abs=slip)
    assert data.qvel[0] - 0.1 * data.qvel[4] == pytest.approx(0.002 * data.qvel[4] * a / G, rel=0.01)


def test_torsion_stops_a_spinning_ball():
    """I alpha = -m_s N about the normal."""
    model, data = compiled(floor(condim=4) + ball(mu=1.0, condim=4, more="0.01 0"))
    data.qvel[5] = 20.0
    stepper = Stepper(model, Newton(0.5))
    inertia = 0.4 * 0.01
    run(stepper, data, 100)
    assert data.qvel[5] == pytest.approx(20.0 - 0.01 * G * data.time / inertia, abs=1e-6)
    run(stepper, data, 100)
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize(("mu", "slips"), [(0.03, True), (0.9, False)])
@pytest.mark.parametrize("law", [Newton(0.6), Coulomb(Newton(0.6), tangential_restitution=0.4)])
def test_an_oblique_bounce(law, mu, slips):
    """If it slips, Lambda_t = mu Lambda_n; if it sticks, the contact point gets -e_t times its velocity before."""
    model, data = compiled(floor() + ball(height=0.5, mu=mu), option='timestep="0.01" gravity="0 0 0"')
    data.qvel[:] = 1.0, 0.0, -2.0, 0.0, 5.0, 0.0
    (event,) = run(Stepper(model, law), data, 40)
    e_t = 0.4 if isinstance(law, Coulomb) else 0.0
    sliding = 1.0 - 0.5  # v - omega R
    impulse = -mu * 1.6 * 2.0 if slips else -(1 + e_t) * sliding * 2 / 7
    assert abs(impulse) <= mu * 3.2 + 1e-12
    assert data.qvel == pytest.approx([1.0 + impulse, 0.0, 1.2, 0.0, 5.0 - 0.1 * impulse / 0.004, 0.0], abs=1e-9)
    assert event.impact.impulse == pytest.approx([3.2])
    assert np.linalg.norm(event.impact.friction_impulse) == pytest.approx(abs(impulse), rel=1e-9)
    assert event.impact.violations.is_admissible()


def test_implicit_damping_of_nothing_changes_nothing_while_inertia_changes():
    """Where no joint is damped, implicitfast is Euler, also for a leg whose foot slides as its knee folds."""
    leg = (
        '<body pos="0 0 .6"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 -.3" size=".02" mass="2"/>'
        '<body pos=".3 0 -.3"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 -.2 0 -.2" size=".02" mass="1"/>'
        '<geom name="foot" pos="-.2 0 -.2" size=".1" mass=".1" friction=".3 0 0"/></body></body>'
    )
    ends = []
    for integrator in ("Euler", "implicitfast"):
        model, data = compiled(floor() + leg, option=f'timestep="0.002" integrator="{integrator}"')
        assert run(Stepper(model, Newton(0.5)), data, 100) == []
        ends.append(np.concatenate([data.qpos, data.qvel]))
    assert abs(ends[0][0]) > 0.05
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-9)


def slide_over_a_sphere(condim, timestep, rotation, start=(1.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)):
    """Return position and velocity after 0.2 s of a ball that slides over a 1 m sphere, in the rotated frame."""
    normal, quat = np.array([math.sin(0.3), 0.0, math.cos(0.3)]), np.zeros(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    place, gravity, turned = (" ".join(map(str, x)) for x in (1.1 * rotation @ normal, -G * rotation[:, 2], quat))
    model, data = compiled(
        f'<geom name="sphere" size="1" quat="{turned}"/><body pos="{place}" quat="{turned}"><freejoint/>'
        f'<geom name="ball" size=".1" mass="1" condim="{condim}" friction=".2 .02 .001"/></body>',
        option=f'timestep="{timestep}" integrator="RK4" gravity="{gravity}"',
        geom='friction="0 0 0"',
    )
    data.qvel[:] = *rotation @ (start - normal * (normal @ start)), *spin
    run(Stepper(model, MaximalDissipation()), data, round(0.2 / timestep))
    return np.concatenate([rotation.T @ data.qpos[:3], rotation.T @ data.qvel[:3], data.qvel[3:]])


ROTATIONS = [np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0] for seed in range(8)]
ROTATIONS = [Q * np.linalg.det(Q) for Q in ROTATIONS]


@pytest.mark.parametrize("condim", [3, 4, 6])
@pytest.mark.parametrize("rotation", ROTATIONS[:4])
def test_sliding_over_a_sphere_does_not_depend_on_how_the_scene_lies_in_the_world(condim, rotation):
    """MuJoCo's directions of friction spin about the normal as it turns, differently for each orientation."""
    start, spin = (-0.5, 1.2, 0.0), (10.0, -20.0, 15.0)
    upright = slide_over_a_sphere(condim, 2e-3, np.eye(3), start, spin)
    np.testing.assert_allclose(slide_over_a_sphere(condim, 2e-3, rotation, start, spin), upright, rtol=0, atol=1e-10)


def test_sliding_over_a_sphere_is_of_second_order_however_the_scene_lies_in_the_world():
    for rotation in ROTATIONS:
        coarse, middle, fine = (slide_over_a_sphere(3, h, rotation) for h in (4e-3, 2e-3, 1e-3))
        assert np.linalg.norm(coarse - middle) > 3.5 * np.linalg.norm(middle - fine)


@pytest.mark.parametrize("inertia", [1e-3, 1e-6, 1e-7])
def test_a_rimless_wheel_rolls_down_whatever_its_inertia(inertia):
    """McGeer's wheel of 8 spokes of 1 m with its mass at the hub: ``omega+ = eta omega-``, with energy kept between.

    Without inertia the foot's impulse is found among contact velocities that are small beside those of the scene.
    """
    half, slope, size = math.pi / 8, 0.1, 1e-5
    feet = "".join(
        f'<geom pos="{math.sin(2 * half * i)} 0 {-math.cos(2 * half * i)}" size="{size}" mass="0" friction="2 0 0"/>'
        for i in range(8)
    )
    hub = f'<inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>'
    joints = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>'
    wheel = f'<body pos="0 0 {math.cos(half) + size}">{hub}{joints}{feet}</body>'
    model, data = compiled(floor(2.0) + wheel, option=sloped(slope, 'timestep="0.002" integrator="RK4"'))
    data.qpos[2], data.qvel[:] = half, (math.cos(half), math.sin(half), 1.0)
    stepper = Stepper(model, MaximalDissipation())
    events = run(stepper, data, 700)
    part = 1.0 / (1.0 + inertia)
    eta, omega = 1.0 - part * (1.0 - math.cos(2 * half)), 1.0
    omega = math.sqrt(omega**2 + 4.0 * part * G * math.sin(half) * math.sin(slope))
    assert [len(event.contacts) for event in events] == [2]
    impact = events[0].impact
    assert impact.collision.pre_velocity[2] == pytest.approx(omega, rel=2e-3)
    assert impact.post_velocity[2] / impact.collision.pre_velocity[2] == pytest.approx(eta, rel=1e-4)
    assert stepper.unlocated == 0
