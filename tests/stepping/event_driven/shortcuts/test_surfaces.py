"""Steps without contact detection where surfaces can move: while they stand still, or no body is near."""

import mujoco
import numpy as np
import pytest
from scenes import compiled
from stepping.event_driven.shortcuts.seen import forgetful, looks, tried

from impactlaw import Contacts, Moreau, Stepper
from impactlaw.scene.detection import Detector
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.event_driven.shortcuts import Apart, Rest, Together

TABLE = '<body mocap="true"><geom name="table" type="box" size="1 1 .1" pos="0 0 -.1" condim="{condim}"/></body>'
BOX = '<body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".2 .2 .1" mass="1" condim="{condim}"/></body>'
BALL = '<body pos="0 0 .1"><freejoint/><geom name="ball" size=".1" mass="1" condim="{condim}"/></body>'


def scene(thing=BOX, condim=3, integrator="RK4"):
    return compiled((TABLE + thing).format(condim=condim), option=f'timestep="0.005" integrator="{integrator}"')


def pauses(i):
    """Return the height of a table in step i: it stands, jumps, rises, jumps again, stops, sinks gently, and stands."""
    if i < 20:
        return 0.0
    if i < 40:
        return 0.002 * (i - 20)
    if i < 44:
        return 0.04 + 0.004 * (i - 40)
    if i < 160:
        return 0.056
    return 0.056 - 1e-6 * min(i - 160, 60) ** 2


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("condim", [1, 3])
@pytest.mark.parametrize("thing", [BOX, BALL])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_the_motion_is_the_same_as_without(thing, condim, integrator, e, monkeypatch):
    model, data = scene(thing, condim, integrator)
    reference = mujoco.MjData(model)
    stepper, other = Stepper(model, Moreau(e)), Stepper(model, Moreau(e))
    step_without, seen = forgetful(other), tried(monkeypatch)
    for i in range(300):
        for state in (data, reference):
            state.mocap_pos[0, 2] = pauses(i + 1)
        stepper.step(data)
        step_without(reference)
        np.testing.assert_allclose(data.qpos, reference.qpos, rtol=0, atol=1e-9)
        np.testing.assert_allclose(data.mocap_pos, reference.mocap_pos, rtol=0, atol=0)
        assert len(stepper.events) == len(other.events)
        assert data.time == pytest.approx(reference.time, abs=1e-12)
    assert {Apart, Rest} <= {type(one.shortcut) for one in seen if one.held}
    assert abs(data.qvel).max() < 1e-9


def test_a_box_at_rest_on_a_table_that_stands_is_looked_at_no_more(monkeypatch):
    model, data = scene()
    stepper = Stepper(model, Moreau(0.0))
    for _ in range(5):
        stepper.step(data)
    seen = looks(monkeypatch)
    for _ in range(200):
        stepper.step(data)
    assert len(seen) <= 20
    seen.clear()
    data.mocap_pos[0, 2] += 1e-4
    stepper.step(data)
    assert seen
    assert data.qpos[2] == pytest.approx(0.1 + 1e-4, abs=1e-9)


def test_what_floats_on_a_table_that_begins_to_move_goes_along(monkeypatch):
    model, data = scene(BALL, condim=1)
    model.opt.gravity[:] = 0
    stepper, seen = Stepper(model, Moreau(0.0)), tried(monkeypatch)
    for _ in range(3):
        stepper.step(data)
    assert seen[-1].held
    assert isinstance(seen[-1].shortcut, Rest | Together)
    for i in range(10):
        data.mocap_pos[0, 2] = 1e-5 * (i + 1)
        stepper.step(data)
        assert data.qpos[2] >= 0.1 + data.mocap_pos[0, 2] - 1e-9
    assert data.qvel[2] == pytest.approx(1.5 * 1e-5 / 0.005)  # it leaves with the velocity at the end of the first step


def test_a_ball_in_flight_is_met_by_a_table_that_jumps_up(monkeypatch):
    model, data = scene(BALL.replace("0 0 .1", "0 0 1"))
    stepper, seen = Stepper(model, Moreau(1.0)), tried(monkeypatch)
    for _ in range(3):
        stepper.step(data)
    assert seen[-1].held
    assert isinstance(seen[-1].shortcut, Apart)
    data.mocap_pos[0, 2] = 1.5  # 300 m/s: past the ball within one step
    stepper.step(data)
    assert len(stepper.events) == 1
    assert data.qvel[2] == pytest.approx(600, rel=1e-2)


def test_a_flight_over_a_moving_table_looks_only_at_its_end(monkeypatch):
    model, data = scene(BALL.replace("0 0 .1", "0 0 1"))
    stepper = Stepper(model, Moreau(1.0))
    heights = 0.05 * np.sin(0.3 * np.arange(1, 40))
    found, find = [], Detector.find
    monkeypatch.setattr(Detector, "find", lambda *args: found.append(find(*args)) or found[-1])
    for height in heights:
        data.mocap_pos[0, 2] = height
        stepper.step(data)
    assert not any(contacts for _, contacts in found)
    assert data.qpos[2] == pytest.approx(1 - 0.5 * 9.81 * data.time**2, abs=1e-12)


def test_a_belt_that_is_told_to_run_takes_along_what_rests_on_it():
    belt = TABLE.replace("size", 'surfacevel=".2 0 0 0 0 0" size')
    model, data = compiled((belt + BOX).format(condim=3), option='timestep="0.005" integrator="RK4"')
    stepper = Stepper(model, Moreau(0.0))
    model.geom_surfacevel[0, 0] = 0.0
    for _ in range(10):
        stepper.step(data)
    assert abs(data.qvel).max() < 1e-12
    model.geom_surfacevel[0, 0] = 0.2
    for _ in range(60):
        stepper.step(data)
    assert data.qvel[0] == pytest.approx(0.2, rel=1e-6)


def test_velocities_of_a_table_are_those_of_a_solid_that_turns():
    """Checks the cross products: w x r at a corner of a table that turns about all axes."""
    model, data = scene(BALL)
    pair = np.array([[model.geom("table").id, model.geom("ball").id]])
    surfaces, spin = Surfaces(model, pair), np.array([0.3, -0.2, 0.5])
    corner, up = np.array([[0.5, 0.3, 0.02]]), np.array([[0.0, 0.0, 1.0]])
    for _ in range(3):
        mujoco.mju_quatIntegrate(data.mocap_quat[0], spin, 0.005)
        surfaces.begin(data, 0.005)
        data.time += 0.005
        surfaces.end(data)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, data.mocap_quat[0])
    velocity = surfaces.motion(data, Contacts(("table/ball",), pair, np.zeros(1), corner, up)).velocity[0]
    world = turn.reshape(3, 3) @ spin
    np.testing.assert_allclose(velocity, -np.cross(world, corner[0]), rtol=1e-3)  # of the second, seen from the first


@pytest.mark.parametrize("speed", [0.3, 3.0])
def test_a_table_that_was_still_strikes_a_ball_in_soft_stepping(speed):
    model, data = scene(BALL.replace("0 0 .1", "0 0 .105"))
    model.opt.gravity[:] = 0
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    for i in range(-3, 40):
        data.mocap_pos[0, 2] = speed * 0.005 * max(i, 0)
        stepper.step(data)
    assert data.qvel[2] == pytest.approx(1.5 * speed, rel=1e-12)
