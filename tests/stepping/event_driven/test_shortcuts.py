"""Steps that need no look at contacts: what they leave out, and that everything which ends that is noticed."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shortcuts_seen import forgetful, looks, tried

from impactlaw import Moreau, Stepper
from impactlaw.errors import OverlapError
from impactlaw.models.builder import cradle
from impactlaw.stepping.event_driven.persistent_contact.position import least_impulse
from impactlaw.stepping.event_driven.shortcuts import Apart, Rest, Together
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases

BOX = """
<mujoco>
  <option timestep="0.005" integrator="{integrator}"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" euler="{slope} 0 0" condim="{condim}" friction="0.6 0.005 0.0001"/>
    <body name="box" euler="{slope} 0 0" pos="{position}">
      <freejoint/>
      <geom name="box" type="box" size="0.25 0.2 0.125" mass="2" condim="{condim}" friction="0.6 0.005 0.0001"/>
    </body>
    {more}
  </worldbody>
</mujoco>"""
WEIGHT = 2 * 9.81


def scene(integrator="RK4", *, condim=1, slope=0.0, more=""):
    """Return a box that lies on a plane, and its state after some steps."""
    angle = np.radians(slope)
    position = " ".join(map(str, 0.125 * np.array([0, -np.sin(angle), np.cos(angle)])))
    text = BOX.format(integrator=integrator, condim=condim, slope=slope, position=position, more=more)
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def settled(model, data, **options):
    stepper = Stepper(model, Moreau(0.0), **options)
    for _ in range(5):
        stepper.step(data)
    return stepper


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize(("condim", "slope"), [(1, 0.0), (3, 0.0), (3, 20.0), (4, 20.0), (6, 0.0)])
def test_a_box_at_rest_is_looked_at_no_more(integrator, condim, slope, monkeypatch):
    model, data = scene(integrator, condim=condim, slope=slope)
    stepper = settled(model, data)
    start, seen = data.qpos.copy(), looks(monkeypatch)
    for _ in range(1000):
        stepper.step(data)
    assert len(seen) <= 100  # where rounding adds up, it is looked at again
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
        assert not seen  # a rest again
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


def test_a_rest_that_does_not_last_is_not_looked_for_again(monkeypatch):
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
    advanced, advance = [], SmoothPhases.advance
    monkeypatch.setattr(SmoothPhases, "advance", lambda *args: advanced.append(1) or advance(*args))
    start = data.qpos.copy()
    for _ in range(10):
        stepper.step(data)
    assert len(advanced) == 10
    np.testing.assert_allclose(data.qpos, start, rtol=0, atol=1e-10)


def test_balls_that_swing_together_are_looked_at_no_more(monkeypatch):
    """Until another one comes near."""
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
    assert collided == 1  # they swing on together
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


def shortcut_of(stepper, data):
    """Return the shortcut that a step has taken, and what takes it; a next step would try it once more."""
    with pytest.MonkeyPatch.context() as patch:
        seen = tried(patch)
        stepper.step(data)
    assert [one.held for one in seen] == [True]
    return seen[0].shortcut, seen[0].phases


def lasts(shortcut, phases):
    with phases.options:
        return shortcut.lasts(phases)


@pytest.mark.parametrize(("velocity", "shift", "kept"), [(0, 0, True), (1e-10, 0, False), (0, 1e-10, False)])
def test_a_rest_allows_for_rounding_only(velocity, shift, kept):
    model, data = scene()
    rest, phases = shortcut_of(settled(model, data), data)
    assert isinstance(rest, Rest)
    data.qvel[0] += velocity
    data.qpos[0] += shift
    assert (lasts(rest, phases) is rest) == kept


@pytest.mark.parametrize(
    ("ball", "position", "velocity", "kept"),
    [
        (4, 0.0, 0.0, True),
        (4, 1e-10, 0.0, True),
        (4, 1e-8, 0.0, False),  # open
        (4, -1e-10, 0.0, False),  # overlaps by more than a correction
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
    """Frames at the ends of a step are the same then."""
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
    """Even where the step would lead away from the overlap."""
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
