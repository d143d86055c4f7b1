"""Damping, servos, activations, applied forces and callbacks under time stepping."""

import math

import mujoco
import pytest
from scenes import compiled, run
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau

G = 9.81


def falling(z=1.1):
    return f'<body pos="0 0 {z}"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="1"/></body>'


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast"])
def test_stiff_joint_damping_is_stable(integrator):
    """h d / I = 500."""
    world = '<body><joint axis="0 1 0" damping="500"/><geom size=".05" pos=".5 0 0" mass=".008"/></body>'
    model, data = compiled(world, option=f'timestep="2e-3" integrator="{integrator}"')
    data.qvel[0] = 10.0
    stepper = stepping(model, Moreau(0.5))
    for _ in range(100):
        stepper.step(data)
        assert abs(data.qvel[0]) < 0.1
    assert data.qvel[0] == pytest.approx(0.5 * 0.008 * G * math.cos(data.qpos[0]) / 500, rel=1e-3)


@pytest.mark.parametrize("integrator", ["implicit", "implicitfast"])
def test_a_stiff_velocity_servo_is_stable_under_the_implicit_integrators(integrator):
    world = '<body><joint name="j" axis="0 1 0"/><geom size=".05" pos=".5 0 0" mass=".008"/></body>'
    actuator = '<actuator><velocity joint="j" kv="500"/></actuator>'
    model, data = compiled(world, actuator, option=f'timestep="2e-3" integrator="{integrator}"')
    data.ctrl[0] = 3.0
    run(stepping(model, Moreau(0.5)), data, 100)
    assert data.qvel[0] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_position_actuators_of_a_million_press_a_slide_onto_its_limit(integrator):
    world = (
        '<body><joint name="j" type="slide" axis="1 0 0" range="0 1" damping="2000"/><geom size=".05" mass="1"/></body>'
    )
    actuator = '<actuator><position joint="j" kp="1e6"/></actuator>'
    model, data = compiled(world, actuator, option=f'timestep="1e-3" integrator="{integrator}"')
    data.ctrl[0] = 1.3
    stepper = stepping(model, Moreau(0))
    run(stepper, data, 500)
    assert data.qpos[0] == pytest.approx(1.0, abs=1e-6)
    assert abs(data.qvel[0]) < 1e-6
    assert run(stepper, data, 100) == []


@pytest.mark.parametrize("kind", ["integrator", "filter", "filterexact", "muscle"])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_activations_and_time_are_those_of_mujoco(kind, integrator):
    world = '<body><joint name="j" type="slide" axis="0 0 1"/><geom size=".05" mass="1"/></body>'
    if kind == "muscle":
        world = world.replace('axis="0 0 1"', 'axis="0 0 1" limited="false"')
        actuator = '<actuator><muscle joint="j" lengthrange="-1 1"/></actuator>'
    else:
        dynamics = f'dyntype="{kind}" dynprm=".05" actlimited="true" actrange="-2 .7"'
        actuator = f'<actuator><general joint="j" {dynamics}/></actuator>'
    model, data = compiled(world, actuator, option=f'integrator="{integrator}" gravity="0 0 0"')
    reference, stepper = mujoco.MjData(model), stepping(model, Moreau(0.5))
    for i in range(200):
        data.ctrl[0] = reference.ctrl[0] = math.sin(0.05 * i) * 3
        stepper.step(data)
        mujoco.mj_step(model, reference)
        if kind != "muscle":
            assert data.act == pytest.approx(reference.act, abs=1e-12)
        assert data.time == reference.time
    assert data.act == pytest.approx(reference.act, abs=1e-9)
    assert data.qpos == pytest.approx(reference.qpos, rel=0.05, abs=1e-4)


def test_applied_forces_and_controls_act():
    model, data = compiled('<body name="b"><freejoint/><geom size=".1" mass="2"/></body>', option='gravity="0 0 0"')
    data.xfrc_applied[1, :3] = 4, 0, 0
    data.qfrc_applied[1] = 6
    run(stepping(model, Moreau(0)), data, 50)
    assert data.qvel[:3] == pytest.approx([0.2, 0.3, 0], abs=1e-12)
    assert data.qpos[:2] == pytest.approx([0.5 * 2 * 0.01, 0.5 * 3 * 0.01], abs=1e-12)


def test_a_control_callback_is_called_once_a_step():
    model, data = compiled(FLOOR + falling(), "<actuator/>")
    calls = []
    mujoco.set_mjcb_control(lambda m, d: calls.append(d.time))
    try:
        run(stepping(model, Moreau(0)), data, 5)
    finally:
        mujoco.set_mjcb_control(None)
    assert calls == pytest.approx([0, 0.002, 0.004, 0.006, 0.008])


@pytest.mark.parametrize("actuation", ["enable", "disable"])
def test_control_callback_is_called_as_by_mujoco(actuation):
    model, data = compiled(FLOOR + falling(), f'<option><flag actuation="{actuation}"/></option>')
    stepper, calls = stepping(model, Moreau(0.5)), []
    mujoco.set_mjcb_control(lambda m, d: calls.append(d.time))
    try:
        run(stepper, data, 3)
    finally:
        mujoco.set_mjcb_control(None)
    assert len(calls) == (3 if actuation == "enable" else 0)
