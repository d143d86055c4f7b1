"""Soft stepping gives mocap bodies velocities, which MuJoCo does not: collisions are those of rigid steps."""

import math

import mujoco
import numpy as np
import pytest
import scenes

from impactlaw import Moreau, Newton, Stepper

TABLE = '<body name="table" mocap="true"><geom name="table" type="box" size="1 1 .1" pos="0 0 -.1"/></body>'
BALL = (
    '<body name="ball" pos="0 0 {height}"><joint type="slide" axis="0 0 1"/>'
    '<geom name="ball" size=".1" mass="1"/></body>'
)
INTEGRATORS = ("Euler", "RK4", "implicitfast")


def compiled(integrator="Euler", height=0.5, gravity=-9.81, world=TABLE):
    option = f'timestep="0.002" integrator="{integrator}" gravity="0 0 {gravity}"'
    return scenes.compiled(world + BALL.format(height=height), option=option)


def drive(model, data, step, path, steps):
    states = []
    for _ in range(steps):
        data.mocap_pos[0, 2] = path(data.time + model.opt.timestep)
        step()
        states.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(states)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("w", [0.5, 1.5, -0.3])
def test_a_paddle_hits_with_its_own_velocity(integrator, w):
    """v+ = -e v- + (1 + e) w, with the error of v-, because a contact is seen up to a step late."""
    e = 0.8
    model, data = compiled(integrator)
    stepper, events = Stepper(model, Newton(e), contact_model="soft"), []

    def step():
        stepper.step(data)
        events.extend(stepper.events)

    drive(model, data, step, lambda t: -0.2 + w * t, 200)
    impact = events[0].impact
    before = impact.collision.pre_velocity[0]
    assert impact.collision.surface_velocity == pytest.approx([-w], abs=1e-9)
    assert impact.post_velocity == pytest.approx([-e * before + (1 + e) * w], abs=1e-9)
    fall = (-w + math.sqrt(w**2 + 2 * 9.81 * 0.6)) / 9.81  # 0.6 - g t^2 / 2 = w t
    assert before == pytest.approx(-9.81 * fall, abs=0.04)
    assert events[0].time == pytest.approx(fall, abs=0.004)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_ball_at_rest_is_struck_by_a_rising_table(integrator):
    """Without gravity the ball is at rest and MuJoCo's rows show no closing contact, but the law gives (1 + e) w."""
    model, data = compiled(integrator, height=0.3, gravity=0.0)
    stepper, events = Stepper(model, Newton(0.5), contact_model="soft"), []

    def step():
        stepper.step(data)
        events.extend(stepper.events)

    drive(model, data, step, lambda t: 2.0 * t, 150)
    (event,) = events
    assert event.impact.collision.pre_velocity == pytest.approx([0.0], abs=1e-12)
    assert event.impact.post_velocity == pytest.approx([3.0], abs=1e-9)
    assert event.time == pytest.approx(0.1, abs=0.004)
    assert data.qvel == pytest.approx([3.0], abs=0.05)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_steps_without_a_collision_are_those_of_mujoco(integrator):
    """A ball at rest on a table that rises gently is left to MuJoCo, bit for bit."""
    runs = []
    for soft in (True, False):
        model, data = compiled(integrator, height=0.1)
        stepper = Stepper(model, Newton(0.8), contact_model="soft")
        step = (
            (lambda data=data, stepper=stepper: stepper.step(data))
            if soft
            else (lambda model=model, data=data: mujoco.mj_step(model, data))
        )
        runs.append(drive(model, data, step, lambda t: 0.01 * (1 - math.cos(5 * t)), 300))
        assert stepper.events == ()
    np.testing.assert_array_equal(*runs)


def test_halves_of_a_step_see_it_too():
    model, data = compiled(height=0.3, gravity=0.0)
    stepper, events = Stepper(model, Newton(0.5), contact_model="soft"), []

    def step():
        mujoco.mj_step1(model, data)
        stepper.finish_step(data)
        events.extend(stepper.events)

    drive(model, data, step, lambda t: 2.0 * t, 150)
    (event,) = events
    assert event.impact.post_velocity == pytest.approx([3.0], abs=1e-9)


def test_only_scenes_in_which_a_mocap_body_collides_look():
    plane = '<geom name="floor" type="plane" size="1 1 1"/>'
    ghost = '<body name="ghost" mocap="true"><geom size=".1" contype="0" conaffinity="0"/></body>'
    for world, looks in ((TABLE, True), (plane, False), (plane + ghost, False)):
        model, _ = compiled(world=world)
        plan = Stepper(model, Newton(0.5), contact_model="soft").plan
        (part,) = (part for part in plan.parts if part.name == "moving surfaces")
        assert plan.surfaces is part.runs is looks


@pytest.mark.parametrize(
    ("angles", "velocity", "belt"),
    [
        ((0.307, -0.006), (0.353, -0.427, 0.329, -0.333), 2.0),
        ((-0.485, 0.015), (-0.394, 0.149, 0.451, 0.298), -2.0),
        ((-0.212, 0.008), (0.313, -0.48, -0.357, 0.279), -2.0),
    ],
)
def test_a_belt_does_not_throw_a_leg_that_jams(angles, velocity, belt):
    """A leg between a belt and a deck: the belt bends an almost straight knee, which can draw any energy from it."""
    hip, knee = math.cos(angles[0]), math.cos(sum(angles))
    model, data = scenes.compiled(
        f"""<geom type="plane" size="9 9 1" surfacevel="{belt} 0 0 0 0 0"/>
        <geom type="box" size="9 9 .1" pos="0 0 {0.1999 + 0.4 * (hip + knee)}"/>
        <body pos="0 0 {0.04995 + 0.4 * knee}">
          <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 .4" size=".05" mass="1"/>
          <body><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05" mass="1"/></body>
        </body>""",
        option='gravity="0 0 0"',
        geom='friction="1"',
    )
    data.qpos[2:], data.qvel[:] = angles, velocity
    before = scenes.energy(model, data)
    stepper = Stepper(model, Moreau(0.0), contact_model="soft")
    stepper.step(data)
    assert scenes.energy(model, data) < before + 2.0 * belt**2  # 2 kg that move with the belt, at twice its speed
    assert stepper.short_steps == 1
