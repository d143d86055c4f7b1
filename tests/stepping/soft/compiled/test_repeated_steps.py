"""Events of compiled soft steps, also where friction holds a box by large impulses with many solutions."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from dm_control import suite
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.errors import SceneError
from impactlaw.stepping.impact_event import ImpactSums


def gripper(rng):
    """Return a box on the floor between two jaws of six pads each, and its data with the jaws pressed together."""
    jaws = ""
    for side in (-1, 1):
        pads = "".join(
            f'<geom type="box" size=".005 .01 .01" pos="0 {y} {z}" friction="{rng.uniform(0.5, 2):.3f}"/>'
            for y in (-0.02, 0, 0.02)
            for z in (-0.02, 0.02)
        )
        jaws += f"""<body pos="{side * 0.035} 0 .05">
            <joint name="jaw{side}" type="slide" axis="{-side} 0 0" range="-.03 .03" damping="5"/>
            <joint type="slide" axis="0 0 1" damping="1"/>
            <inertial pos="0 0 0" mass=".1" diaginertia="1e-4 1e-4 1e-4"/>{pads}</body>"""
    model, data = compiled(
        f"""<geom type="plane" size="1 1 1"/>{jaws}<body pos="0 0 .05"><freejoint/>
            <geom type="box" size=".03 .03 .03" mass="{rng.uniform(0.02, 0.5):.3f}" friction="1.5"/></body>""",
        rest='<actuator><motor joint="jaw-1" gear="1"/><motor joint="jaw1" gear="1"/></actuator>',
        option='timestep=".002" cone="elliptic"',
    )
    data.ctrl[:] = rng.uniform(20, 200)
    return model, data


@pytest.mark.parametrize(("seed", "steps"), [(11, 11), (13, 57)])
def test_events_of_a_squeezed_box_are_told(seed, steps):
    rng = np.random.default_rng(seed)
    model, data = gripper(rng)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    data.qvel[:] = rng.normal(0, 0.5, model.nv)
    told = 0
    for k in range(steps):
        if k % 10 == 0:
            data.qvel[:] += rng.normal(0, 0.5, model.nv)
        stepper.step(data)
        for event in stepper.events:
            violations = event.impact.violations
            assert max(violations.kinematic, violations.kinetic, violations.energetic) < 1e-6 * violations.pre_speed
            told += 1
        assert sum(event.impact.energy_change for event in stepper.events) == pytest.approx(
            stepper.sums.energy_change, abs=1e-9
        )
    assert told > 0


def landed():
    """Return a stepper and data after the first collision of a ball that falls on a plane."""
    model, data = compiled('<geom type="plane" size="1 1 1"/><body pos="0 0 .11"><freejoint/><geom size=".1"/></body>')
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    while not stepper.sums.collisions:
        stepper.step(data)
    return stepper, data


def test_a_callback_that_is_set_after_a_collision_lets_nothing_be_told_once_more():
    stepper, data = landed()
    mujoco.set_mjcb_control(lambda model, data: None)
    try:
        for _ in range(3):
            stepper.step(data)
            assert stepper.sums.collisions == 0
            assert stepper.events == ()
    finally:
        mujoco.set_mjcb_control(None)
    assert stepper.short_steps == stepper.unlocated == 0


def driven(domain, task, steps):
    """Yield the stepper after each step of a robot of dm_control under random controls."""
    model = suite.load(domain, task).physics.model.ptr
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    for k in range(steps):
        if k % 10 == 0:
            data.ctrl[:] = np.clip(data.ctrl + 0.1 * rng.normal(size=model.nu), -1, 1)
        stepper.step(data)
        yield stepper


def test_events_of_damped_joints_are_told_from_the_state_alone():
    """The effect of damping on M must not depend on earlier steps, because the data of the repeated step are new."""
    told = 0
    for stepper in driven("humanoid", "stand", 200):
        assert len(stepper.events) == stepper.sums.collisions
        told += len(stepper.events)
    assert told > 20


def test_what_is_told_are_the_collisions_of_compiled_code_and_not_other_solutions():
    """A quadruped falls over its own legs: in one step with eight collisions, the law in Python scales one more."""
    told = 0
    for stepper in driven("quadruped", "walk", 490):
        assert ImpactSums.of(stepper.events)[0] == stepper.sums.collisions
        assert ImpactSums.of(stepper.events) == pytest.approx(stepper.sums, rel=1e-8, abs=1e-10)
        told += len(stepper.events)
    assert told > 100


def test_a_callback_that_is_set_before_a_collision_is_told_does_not_prevent_it():
    stepper, _ = landed()
    mujoco.set_mjcb_control(lambda model, data: None)
    try:
        (event,) = stepper.events
    finally:
        mujoco.set_mjcb_control(None)
    assert event.impact.energy_change == pytest.approx(stepper.sums.energy_change)


def test_events_that_are_asked_for_after_the_model_has_changed_are_refused():
    stepper, _ = landed()
    stepper.model.geom_size[1] = 0.05
    with pytest.raises(SceneError, match="changed"):
        _ = stepper.events


def test_what_is_told_does_not_depend_on_what_was_told_before():
    """The stepper that repeats steps is made once: the last collisions of a fall, read in any order."""
    model = suite.load("walker", "walk").physics.model.ptr
    told = []
    for asks in (True, False):
        data, stepper, steps = mujoco.MjData(model), Stepper(model, Moreau(0.5), contact_model="soft"), []
        for _ in range(900):
            found = stepper.stepping.step(data)
            if found:
                steps.append((found, found() if asks else None))
        assert len(steps) > 5
        again = [(found()) for found, _ in reversed(steps)]
        told.append([event.impact.post_velocity for events in reversed(again) for event in events])
    np.testing.assert_array_equal(*map(np.array, told))
