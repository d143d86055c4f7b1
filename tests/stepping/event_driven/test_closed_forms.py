"""Rigid stepping against closed forms: bouncing ball, cradle, contact at rest and on curved surfaces."""

import copy
import math
import pickle

import mujoco
import numpy as np
import pytest
from scenes import INTEGRATORS, compiled, energy, mass_matrix

from impactlaw import Fremond, Moreau, Stepper, read_contacts
from impactlaw.errors import SceneError
from impactlaw.models import SCENES, builder, load

G = 9.81


def ball_above_plane(integrator, timestep, height=1.0):
    world = f"""<geom name="floor" type="plane" size="1 1 1" condim="1"/>
        <body pos="0 0 {0.1 + height}"><freejoint/><geom name="ball" size=".1" condim="1"/></body>"""
    return compiled(world, option=f'timestep="{timestep}" integrator="{integrator}"')


def bounce(t, e):
    """Return the height of a ball dropped from 1 m above the plane, and the times of its impacts so far."""
    fall = math.sqrt(2 / G)
    if t < fall:
        return 1 - 0.5 * G * t * t
    start, speed = fall, e * G * fall
    while speed > 1e-12:
        flight = 2 * speed / G
        if t < start + flight:
            return speed * (t - start) - 0.5 * G * (t - start) ** 2
        start, speed = start + flight, e * speed
    return 0.0


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9, 1.0])
def test_bouncing_ball_follows_its_closed_form_at_a_large_step(e):
    model, data = ball_above_plane("RK4", 0.05)
    stepper = Stepper(model, Moreau(e))
    times = []
    for _ in range(40):
        stepper.step(data)
        times += [event.time for event in stepper.events]
        assert data.qpos[2] - 0.1 == pytest.approx(bounce(data.time, e), abs=1e-9)
    expected, speed = [math.sqrt(2 / G)], e * math.sqrt(2 * G)
    while (
        speed**2 / (2 * G) > 1e-9 and expected[-1] + 2 * speed / G < 2.0
    ):  # rebounds that rise above the gap tolerance
        expected.append(expected[-1] + 2 * speed / G)
        speed *= e
    assert times == pytest.approx(expected, abs=1e-9)
    assert stepper.unlocated == 0


def test_euler_converges_with_order_one():
    errors = []
    for timestep in (4e-3, 2e-3, 1e-3, 5e-4):
        model, data = ball_above_plane("Euler", timestep)
        stepper = Stepper(model, Moreau(1))
        worst = 0.0
        for _ in range(round(1.2 / timestep)):
            stepper.step(data)
            worst = max(worst, abs(data.qpos[2] - 0.1 - bounce(data.time, 1)))
        errors.append(worst)
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(1.0, abs=0.1)


def test_sliding_over_a_sphere_converges_with_the_order_of_rk4_and_contact():
    """Contact held on a curved surface is of second order: the gap stays closed, and the energy converges."""
    errors = []
    for timestep in (2e-2, 1e-2, 5e-3):
        world = """<geom name="hill" size=".5" pos="0 0 -.6" condim="1"/>
            <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
            <geom name="ball" size=".1" mass="1" condim="1"/></body>"""
        model, data = compiled(world, option=f'timestep="{timestep}" integrator="RK4"')
        data.qvel[0] = 0.5
        before = energy(model, data)
        stepper = Stepper(model, Moreau(0.5))
        for _ in range(round(0.4 / timestep)):
            stepper.step(data)
            assert not stepper.events
            assert abs(math.hypot(data.qpos[0], data.qpos[1] + 0.6) - 0.6) < 1e-9
        errors.append(abs(energy(model, data) - before))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=0.1)


def test_cradle_repeats_the_exact_exchange_and_keeps_its_energy():
    model, data = load("newtons_cradle")
    speed = data.qvel[0]
    before = energy(model, data)
    lowest = before - 0.5 * data.qvel @ mass_matrix(model, data) @ data.qvel
    stepper = Stepper(model, Fremond.reversal())
    events = []
    while len(events) < 20:
        stepper.step(data)
        events += stepper.events
    for k, event in enumerate(events):
        first, last = (0, 4) if k % 2 == 0 else (4, 0)
        sign = 1 if k % 2 == 0 else -1
        expected = np.zeros(5)
        expected[last] = sign * speed
        assert event.impact.post_velocity == pytest.approx(expected, abs=1e-8)
        assert event.impact.collision.pre_velocity[first] == pytest.approx(sign * speed, abs=1e-8)
    assert (energy(model, data) - before) / (before - lowest) == pytest.approx(0.0, abs=1e-8)


def _boxes(n, gap=0.0, mass=None):
    bodies = "".join(
        f'<body pos="0 0 {0.125 + i * 0.25 + (i + 1) * gap}"><freejoint/>'
        f'<geom name="box{i}" type="box" size=".125 .125 .125" mass="{mass[i] if mass else 1}" condim="1"/></body>'
        for i in range(n)
    )
    return '<geom name="floor" type="plane" size="1 1 1" condim="1"/>' + bodies


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_a_ball_comes_to_rest_and_stays(integrator, e):
    model, data = ball_above_plane(integrator, 5e-3, height=0.05)
    stepper = Stepper(model, Moreau(e))
    for _ in range(600):
        stepper.step(data)
    assert abs(data.qvel).max() < 1e-12
    assert abs(data.qpos[2] - 0.1) <= 1e-9
    height = data.qpos[2]
    for _ in range(200):
        stepper.step(data)
        assert not stepper.events
        assert data.qpos[2] == pytest.approx(height, abs=1e-12)
    assert stepper.unlocated == 0


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_flat_box_comes_to_rest_on_four_equal_impulses(integrator):
    model, data = compiled(_boxes(1, gap=0.02), option=f'timestep="2e-3" integrator="{integrator}"')
    stepper = Stepper(model, Moreau(0.5))
    first = None
    for _ in range(300):
        stepper.step(data)
        if first is None and stepper.events:
            first = stepper.events[0].impact
    assert first is not None
    assert first.impulse == pytest.approx(np.full(4, first.impulse.mean()), rel=1e-12)
    assert abs(data.qvel).max() < 1e-12
    assert abs(data.qpos[2] - 0.125) <= 1e-9
    assert not stepper.events


@pytest.mark.parametrize("n", [5, 20])
@pytest.mark.parametrize("ratio", [1, 1000])
def test_a_stack_at_rest_stays_at_rest(n, ratio):
    model, data = compiled(
        _boxes(n, mass=[ratio ** (i % 2) for i in range(n)]), option='timestep="2e-3" integrator="RK4"'
    )
    start = data.qpos.copy()
    stepper = Stepper(model, Moreau(0.5))
    for _ in range(10):
        stepper.step(data)
        assert not stepper.events
    assert data.qpos == pytest.approx(start, abs=1e-9)
    assert abs(data.qvel).max() < 1e-9


def test_a_dropped_stack_comes_to_rest():
    model, data = compiled(_boxes(4, gap=0.0078125), option='timestep="2e-3" integrator="RK4"')
    stepper = Stepper(model, Moreau(0.5))
    for _ in range(250):
        stepper.step(data)
    assert abs(data.qvel).max() < 1e-9
    assert not stepper.events
    assert data.qpos[2::7] == pytest.approx(0.125 + 0.25 * np.arange(4), abs=4e-9)
    assert stepper.unlocated == 0


def test_a_tumbling_elastic_box_keeps_its_energy():
    world = '<geom name="floor" type="plane" size="1 1 1" condim="1"/><body pos="0 0 .6" euler="20 30 40"><freejoint/>'
    world += '<geom name="box" type="box" size=".1 .1 .1" condim="1"/></body>'
    model, data = compiled(world, option='timestep="2e-3" integrator="RK4"')
    before = energy(model, data)
    stepper = Stepper(model, Moreau(1))
    count = 0
    for _ in range(500):
        stepper.step(data)
        count += len(stepper.events)
    assert count >= 3
    assert energy(model, data) == pytest.approx(before, rel=1e-9)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_no_scene_penetrates_or_gains_energy(scene, integrator):
    model, data = load(scene)
    model.opt.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))
    stepper = Stepper(model, Moreau(0.8), friction="ignore")
    for _ in range(round(0.7 / model.opt.timestep)):
        stepper.step(data)
        assert read_contacts(model, data, within=0.0).gap.min(initial=0.0) >= -1.01e-9
        for event in stepper.events:
            assert abs(event.contacts.gap).max() <= 1e-9
            assert event.impact.violations.is_admissible()
            assert event.impact.residual < 1e-9
            assert event.impact.energy_change <= 1e-12 * event.impact.collision.kinetic_energy


@pytest.mark.parametrize("n", [10, 100])
@pytest.mark.parametrize("launched", [1, 3])
def test_cradles_of_any_size_pass_on_any_number_of_balls(n, launched):
    model = builder.chain(n, launched=launched).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    before = data.qvel.copy()
    stepper = Stepper(model, Fremond.reversal())
    stepper.step(data)
    assert data.qvel == pytest.approx(before[::-1], abs=1e-12)


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_data_of_another_model_are_refused(contact_model):
    """MuJoCo would read and write beyond their arrays."""
    model, _ = load("billiard_rack")
    _, data = load("bouncing_ball")
    with pytest.raises(SceneError, match="another model"):
        Stepper(model, Moreau(1), contact_model=contact_model).step(data)


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}], ids=str)
def test_data_of_another_model_are_refused_where_models_have_no_signature(options):
    """Models from a pickle or a binary file have no signature; data of a copy of the model are accepted."""
    model, other = (pickle.loads(pickle.dumps(load(name)[0])) for name in ("billiard_rack", "bouncing_ball"))
    stepper = Stepper(model, Moreau(1), **options)
    with pytest.raises(SceneError, match="another model"):
        stepper.step(mujoco.MjData(other))
    stepper.step(mujoco.MjData(copy.copy(model)))


def test_data_of_as_many_bodies_that_hang_otherwise_are_refused():
    """Also without signatures: three links in a chain have a larger mass matrix than three separate links."""
    link = '<body pos="0 0 .3"><joint axis="0 1 0"/><geom size=".05"/>'
    chain, apart = (
        pickle.loads(pickle.dumps(mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{x}</worldbody></mujoco>")))
        for x in (3 * link + 3 * "</body>", 3 * (link + "</body>"))
    )
    with pytest.raises(SceneError, match="another model"):
        Stepper(chain, Moreau(1), scheme="time-stepping").step(mujoco.MjData(apart))
