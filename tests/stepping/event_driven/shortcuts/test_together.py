"""Steps of bodies that move together, or far from others, and the events that end this."""

import mujoco
import numpy as np
import pytest
from stepping.event_driven.shortcuts.resting import lasts, scene, settled, shortcut_of
from stepping.event_driven.shortcuts.seen import forgetful, looks, tried

from impactlaw import Moreau, Stepper
from impactlaw.errors import OverlapError
from impactlaw.models import load
from impactlaw.models.builder import cradle
from impactlaw.stepping.event_driven.persistent_contact.position import least_impulse
from impactlaw.stepping.event_driven.shortcuts import Apart, Together


def test_balls_that_swing_together_are_looked_at_no_more(monkeypatch):
    """Until another ball comes near."""
    model = cradle(5).compile()
    data = mujoco.MjData(model)
    data.qpos[0] = -0.4
    stepper = Stepper(model, Moreau(0.0))
    step_without, reference = forgetful(Stepper(model, Moreau(0.0))), mujoco.MjData(model)
    reference.qpos[:] = data.qpos
    seen, collided = looks(monkeypatch), 0
    for _ in range(1000):
        stepper.step(data)
        collided += len(stepper.events)
    assert collided == 1  # they keep swinging together
    assert len(seen) < 100
    for _ in range(1000):
        step_without(reference)
    np.testing.assert_allclose(data.qpos, reference.qpos, rtol=0, atol=1e-9)
    np.testing.assert_allclose(data.qvel, reference.qvel, rtol=0, atol=1e-8)


def test_balls_in_touch_part_when_one_is_pulled():
    model = cradle(5).compile()
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.0))
    for _ in range(10):
        stepper.step(data)
    data.qfrc_applied[4] = 1e-3
    stepper.step(data)
    stepper.step(data)
    assert data.qvel[4] > 1e-6
    assert np.abs(data.qvel[:4]).max() < 1e-12


def test_a_velocity_given_in_flight_counts():
    model, data = scene()
    data.qpos[2] += 1.0
    stepper = Stepper(model, Moreau(0.0))
    for _ in range(5):
        stepper.step(data)
    data.qvel[2] = -300.0
    stepper.step(data)
    assert [event.time for event in stepper.events]
    assert data.qpos[2] == pytest.approx(0.125, abs=1e-8)


@pytest.mark.parametrize(
    ("ball", "position", "velocity", "kept"),
    [
        (4, 0.0, 0.0, True),
        (4, 1e-10, 0.0, True),
        (4, 1e-8, 0.0, False),  # open
        (4, -1e-10, 0.0, False),  # overlaps by more than can be corrected
        (4, 0.0, -1e-9, True),
        (4, 0.0, -1e-8, False),  # begins to overlap
        (4, 0.0, 1e-6, False),  # opens
        (4, 1e-3, 0.0, False),  # far
        (0, -1e-3, 0.0, False),
    ],
)
def test_contacts_together_allow_for_rounding_only(ball, position, velocity, kept):
    model = cradle(5).compile()
    data = mujoco.MjData(model)
    model.opt.gravity[:] = 0.0
    data.qvel[:] = 0.1
    together, phases = shortcut_of(settled(model, data), data)
    assert isinstance(together, Together)
    data.qpos[ball] += position
    data.qvel[ball] += velocity
    assert (lasts(together, phases) is together) == kept


def test_other_contacts_of_the_same_number_are_not_those_together():
    model = cradle(3).compile()
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1
    data.qpos[2] = 0.01
    together, phases = shortcut_of(settled(model, data), data)
    assert isinstance(together, Together)
    assert together.pattern.labels == ("ball1/ball2",)
    data.qpos[:] -= [0.01, 0.0, 0.01]
    assert lasts(together, phases) is None


def test_a_body_is_met_by_one_that_turns_a_whole_turn_in_a_step(monkeypatch):
    """The frames at the start and at the end of the step are equal then."""
    turn = 2 * np.pi / 0.005
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>
        <body><joint name="turn" axis="0 0 1"/><geom type="capsule" size=".02" fromto="-1 0 0 1 0 0" condim="1"/></body>
        <body pos="0 3 0"><joint name="y" type="slide" axis="0 1 0"/><geom size=".1" condim="1"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[:] = turn, -4.0
    stepper, seen = Stepper(model, Moreau(0.0)), tried(monkeypatch)
    while data.qpos[1] > -2.6 and not stepper.events:
        stepper.step(data)
    assert {type(one.shortcut) for one in seen} == {Apart}
    assert stepper.events
    assert 3 + stepper.events[0].qpos[1] > 0.9


def test_a_position_given_in_flight_counts():
    """Even if the step would lead out of the overlap."""
    model, data = scene()
    data.qpos[2] += 1.0
    stepper = settled(model, data)
    assert isinstance(shortcut_of(stepper, data)[0], Apart)
    data.qpos[2], data.qvel[2] = 0.12, 5.0
    with pytest.raises(OverlapError):
        stepper.step(data)


def test_a_contact_is_never_pulled():
    gradients = np.array([[2.0, 0.0]])
    assert least_impulse(gradients, np.array([3.0])) == pytest.approx(0.75)
    assert least_impulse(gradients, np.array([-3.0])) == 0.0


def test_balls_that_fly_apart_do_not_make_steps_longer_for_those_in_touch(monkeypatch):
    """None of them moves past another by its size, though all together move by more."""
    model, data = load("billiard_rack")
    stepper, seen, collided = Stepper(model, Moreau(0.8)), tried(monkeypatch), 0
    for _ in range(400):
        stepper.step(data)
        collided += len(stepper.events)
    assert collided == 3
    assert np.count_nonzero([attempt.held for attempt in seen]) > 380
