"""Steps of bodies at rest do not detect contacts, and any change that ends the rest is noticed."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stepping.event_driven.shortcuts.resting import lasts, scene, settled, shortcut_of
from stepping.event_driven.shortcuts.seen import forgetful, looks

from impactlaw import Moreau, Stepper
from impactlaw.stepping.event_driven.shortcuts import Rest

WEIGHT = 2 * 9.81


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize(("condim", "slope"), [(1, 0.0), (3, 0.0), (3, 20.0), (4, 20.0), (6, 0.0)])
def test_a_box_at_rest_is_looked_at_no_more(integrator, condim, slope, monkeypatch):
    model, data = scene(integrator, condim=condim, slope=slope)
    stepper = settled(model, data)
    start, seen = data.qpos.copy(), looks(monkeypatch)
    for _ in range(1000):
        stepper.step(data)
    assert len(seen) <= 100  # contacts are detected again where rounding accumulates
    np.testing.assert_allclose(data.qpos, start, rtol=0, atol=2e-11)
    assert np.abs(data.qvel).max() < 1e-10
    assert data.time == pytest.approx(1005 * 0.005)
    assert (data.qfrc_applied == 0).all()


def test_contacts_stay_readable():
    model, data = scene()
    settled(model, data)
    assert data.ncon == 4
    np.testing.assert_allclose(data.contact.dist, 0.0, atol=1e-10)
    np.testing.assert_allclose(np.abs(data.contact.pos), np.tile([0.25, 0.2, 0.0], (4, 1)), atol=1e-9)
    assert (data.contact.efc_address == -1).all()


def test_a_force_that_the_contacts_take_up_leaves_the_box_at_rest(monkeypatch):
    model, data = scene(condim=3)
    stepper = settled(model, data)
    start = data.qpos.copy()
    for force in (0.5 * WEIGHT, -30.0, 0.999 * WEIGHT):
        data.qfrc_applied[2] = force
        for _ in range(20):
            stepper.step(data)
        assert data.qfrc_applied[2] == force
        np.testing.assert_allclose(data.qpos, start, rtol=0, atol=2e-11)
        seen = looks(monkeypatch)
        stepper.step(data)
        assert not seen  # at rest again
        monkeypatch.undo()


@pytest.mark.parametrize("way", ["applied force", "body force", "gravity", "velocity", "position"])
def test_what_ends_a_rest_is_seen_in_the_same_step(way):
    model, data = scene(condim=3)
    stepper = settled(model, data)
    if way == "applied force":
        data.qfrc_applied[2] = 1.5 * WEIGHT
    elif way == "body force":
        data.xfrc_applied[1, :3] = 0.8 * WEIGHT, 0.0, 0.0
    elif way == "gravity":
        model.opt.gravity[:] = 0, 0, 1.0
    elif way == "velocity":
        data.qvel[0] = 3.0
    else:
        data.qpos[2] += 0.01
    fresh = mujoco.MjData(model)
    mujoco.mj_copyData(fresh, model, data)
    other = Stepper(model, Moreau(0.0))
    for _ in range(20):
        stepper.step(data)
        other.step(fresh)
        np.testing.assert_allclose(data.qpos, fresh.qpos, rtol=0, atol=1e-10)
        np.testing.assert_allclose(data.qvel, fresh.qvel, rtol=0, atol=1e-8)
    assert np.abs(data.qvel).max() > 1e-3 or way == "position"


def test_friction_holds_no_more_than_its_cone():
    model, data = scene(condim=3)
    stepper = settled(model, data)
    for part, moves in ((0.59, False), (0.62, True)):
        data.qfrc_applied[0] = part * WEIGHT
        for _ in range(20):
            stepper.step(data)
        assert (data.qvel[0] > 1e-3) == moves


def test_a_rest_of_one_data_is_none_of_another():
    model, data = scene(condim=3)
    stepper = settled(model, data)
    other = mujoco.MjData(model)
    mujoco.mj_copyData(other, model, data)
    other.qfrc_applied[2] = 2 * WEIGHT
    for _ in range(10):
        stepper.step(data)
        stepper.step(other)
    assert data.qpos[2] == pytest.approx(0.125, abs=1e-11)
    assert other.qvel[2] == pytest.approx(9.81 * 0.05)


def test_a_ball_that_falls_on_a_resting_box_collides_as_ever():
    ball = '<body pos="0 0 0.5"><freejoint/><geom name="ball" type="sphere" size="0.1" mass="1" condim="3"/></body>'
    ends = []
    for rests in (True, False):
        model, data = scene(condim=3, more=ball)
        stepper = Stepper(model, Moreau(0.5))
        step = stepper.step if rests else forgetful(stepper)
        events = []
        for _ in range(400):
            step(data)
            events += [event.time for event in stepper.events]
        ends.append((events, data.qpos.copy()))
    (times, end), (expected, expected_end) = ends
    assert len(times) > 5
    np.testing.assert_allclose(times, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(end, expected_end, rtol=0, atol=1e-8)


@given(
    pushes=st.lists(
        st.tuples(st.integers(1, 8), *(st.sampled_from([0.0, 0.0, 0.3, -0.5, 0.9]) for _ in range(3))),
        min_size=1,
        max_size=4,
    ),
    integrator=st.sampled_from(["Euler", "RK4", "implicitfast"]),
    condim=st.sampled_from([1, 3]),
)
@settings(max_examples=25, deadline=None)
def test_the_motion_is_the_same_as_without(pushes, integrator, condim):
    model, data = scene(integrator, condim=condim)
    without = mujoco.MjData(model)
    stepper, step_without = Stepper(model, Moreau(0.2)), forgetful(Stepper(model, Moreau(0.2)))
    for steps, *force in pushes:
        for state in (data, without):
            state.xfrc_applied[1, :3] = WEIGHT * np.array(force)
        for _ in range(3 * steps):
            stepper.step(data)
            step_without(without)
        np.testing.assert_allclose(data.qpos, without.qpos, rtol=0, atol=1e-8)
        np.testing.assert_allclose(data.qvel, without.qvel, rtol=0, atol=1e-7)


def test_a_rest_that_does_not_last_moves_nothing():
    """A damped joint integrates another force than the one that balances it."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option integrator="RK4" timestep="0.005"/><worldbody><geom type="plane" size="0 0 1"/>'
        '<body pos="0 0 0.1"><joint type="hinge" axis="0 1 0" damping="3"/>'
        '<geom type="capsule" fromto="0.1 0 0.1 0.5 0 0" size="0.1" mass="1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.0))
    for _ in range(400):
        stepper.step(data)
    start = data.qpos.copy()
    for _ in range(10):
        stepper.step(data)
    np.testing.assert_allclose(data.qpos, start, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("velocity", "shift", "kept"), [(0, 0, True), (1e-10, 0, False), (0, 1e-10, False)])
def test_a_rest_allows_for_rounding_only(velocity, shift, kept):
    model, data = scene()
    rest, phases = shortcut_of(settled(model, data), data)
    assert isinstance(rest, Rest)
    data.qvel[0] += velocity
    data.qpos[0] += shift
    assert (lasts(rest, phases) is rest) == kept
