"""Drifting constraints, and servos, beside collisions: limits closed by drift, and pulls of a mocap body."""

import mujoco
import numpy as np
import pytest
from scenes import compiled as compile_scene

from impactlaw import Fremond, Moreau, Poisson, Stepper

KNEE = """<body><joint name="knee" axis="0 1 0" range="0 120"/><geom size=".1" pos="0 0 -.4" mass="1"/>
    <body pos="0 0 -.4"><joint name="slip" type="slide" axis="1 0 0" range="0 .1" armature=".01"/>
    <geom size=".1" mass=".1"/></body></body>"""
COUPLING = '<equality><joint joint1="slip" joint2="knee" polycoef="0 .003 0 0 0"/></equality>'
"""A knee whose shank slips by 3 mm per radian, as in musculoskeletal models; both joints have a limit at 0."""


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_knee_is_not_thrown_back_by_the_slip_of_its_shank(e):
    """To stop a slip of 1 cm/s the knee would have to turn 3.3 rad/s faster."""
    model, data = compile_scene(KNEE, COUPLING, option='gravity="0 0 0"')
    data.qpos[:], data.qvel[:] = (-1e-3, -1e-5), (-1.0, -0.01)
    stepper = Stepper(model, Moreau(e), scheme="time-stepping")
    stepper.step(data)
    np.testing.assert_allclose(data.qvel[0], e, atol=1e-6)
    assert data.qvel[1] >= -1e-9
    assert stepper.short_steps == 0


PULLED = """<mujoco><option timestep="0.002" gravity="-.5 0 0"/><worldbody>
  <body name="hand" mocap="true"/>
  <body name="arm"><joint type="slide" axis="1 0 0" limited="true" range="0 1"/><joint type="slide" axis="0 0 1"/>
    <geom size=".1" mass="1" contype="0" conaffinity="0"/>{}</body>{}</worldbody>
  <equality><connect body1="arm" body2="hand" anchor="0 0 0"/></equality></mujoco>"""
FINGER = """<body pos="0 0 1"><joint type="slide" axis="0 0 1" limited="true" range="0 1"/>
  <geom size=".02" mass=".001" contype="0" conaffinity="0"/></body>"""


@pytest.mark.parametrize("inside", [True, False])
def test_what_a_mocap_body_pulls_against_a_stop_stays_there_while_a_finger_closes(inside):
    """Pull and stop cancel, except for a tiny part that moves the arm along the stop: this is the work of the hand."""
    model = mujoco.MjModel.from_xml_string(PULLED.format(FINGER, "") if inside else PULLED.format("", FINGER))
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), scheme="time-stepping")
    data.mocap_pos[0] = -1.0, 0.0, 6e-4
    data.qpos[2], data.qvel[2] = 1e-5, -0.02
    stepper.step(data)
    np.testing.assert_allclose(data.qvel, [0.0, 3e-3, 0.01], rtol=0.02, atol=1e-12)
    assert stepper.shortfall < 1e-12
    assert stepper.short_steps == 0


KNOB = """<body><joint name="knob" range="-90 0"/><geom size=".05" mass=".1" contype="0"/></body>
    <body><joint name="burner" type="slide" axis="0 0 1" range="-.009 0"/>
    <geom size=".05" mass=".01" contype="0"/></body>"""
TURNED = '<equality><joint joint1="knob" joint2="burner" polycoef="0 174 0 0 0"/></equality>'
"""A knob that lifts a burner, as in the kitchen of gymnasium-robotics; both joints have a limit at 0."""


@pytest.mark.parametrize("start", [(0.0, 1.0), (-1.0, 1.0), (-100.0, 1.0), (100.0, 0.0), (100.0, -1.0), (1.0, -1.0)])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_coupling_that_is_violated_adds_no_energy_where_a_limit_stops_one_of_its_ends(e, start):
    """To keep its drift of 174 rad/s, the knob would get 174 times what the burner has lost."""
    model, data = compile_scene(KNOB, TURNED, option='gravity="0 0 0"')
    data.qvel[:] = start
    stepper, kinetic = Stepper(model, Moreau(e), scheme="time-stepping"), []
    for _ in range(60):
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        kinetic.append(data.energy[1])
        stepper.step(data)
    assert np.diff(kinetic).max() < 1e-2 * kinetic[0]
    assert stepper.short_steps == 0


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_limit_stops_a_burner_as_the_law_says_whose_coupling_is_violated(e):
    model, data = compile_scene(KNOB, TURNED, option='gravity="0 0 0"')
    data.qvel[:] = -1.0, 1.0
    stepper = Stepper(model, Moreau(e), scheme="time-stepping")
    stepper.step(data)
    np.testing.assert_allclose(data.qvel, [-1.0, -e], atol=1e-8)
    assert stepper.shortfall < 1e-9


BOX = """<body name="{0}" pos="{1} 0 .05"><freejoint/><geom type="box" size=".1 .05 .05" mass="1"/></body>"""
WELDED = """<equality><weld body1="left" body2="right" solref="{} 1"/></equality>
    <contact><exclude body1="left" body2="right"/></contact>"""


@pytest.mark.parametrize("softness", [0.02, 0.1])
@pytest.mark.parametrize("drift", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("e", [0.5, 1.0])
def test_a_weld_that_drifts_adds_next_to_no_energy_where_its_boxes_land(e, drift, softness):
    """Regression: with e = 1 its drift added energy from most of these starts."""
    world = '<geom type="plane" size="9 9 1"/>' + BOX.format("left", -0.11) + BOX.format("right", 0.11)
    frictionless = 'friction="0" condim="1"'
    model, data = compile_scene(world, WELDED.format(softness), option='gravity="0 0 0"', geom=frictionless)
    for seed in range(10):
        mujoco.mj_resetData(model, data)
        data.qvel[:] = drift * np.random.default_rng(seed).normal(size=model.nv)
        data.qvel[2::6] -= 1.0
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        before = data.energy[1]
        stepper = Stepper(model, Moreau(e), scheme="time-stepping")
        stepper.step(data)
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        assert data.energy[1] < before * (1.0 + 1e-2)
        assert stepper.shortfall < 1e-6


def _geared(offset):
    """Return two parallel slides, geared 20 : 1, the first one with a limit, and their coupling."""
    hits, geared = (
        f'<body pos="0 {y} 0"><joint name="{name}" type="slide" axis="1 0 0" {more}/><geom size=".1" mass="1"/></body>'
        for name, y, more in ((f"hits{offset}", offset, 'range="-.001 1"'), (f"geared{offset}", offset + 1, ""))
    )
    return hits + geared, f'<joint joint1="geared{offset}" joint2="hits{offset}" polycoef="0 20 0 0 0"/>'


def _hit(drifts, e):
    """Return the stepper of such pairs after they hit their limits at 1 m/s, with drifts as parts of their speed."""
    bodies, couplings = zip(*(_geared(2 * i) for i in range(len(drifts))), strict=True)
    rest = f"<equality>{''.join(couplings)}</equality>"
    model, data = compile_scene("".join(bodies), rest, option='gravity="0 0 0" timestep=".002"')
    data.qvel[0::2], data.qvel[1::2] = -1.0, -20.0 + 20.0 * np.array(drifts)
    stepper = Stepper(model, Moreau(e), scheme="time-stepping")
    while not stepper.sums.collisions:
        stepper.step(data)
    return stepper


@pytest.mark.parametrize("drift", [1.0, 0.2, 0.08])
def test_gears_that_give_way_do_not_drive_the_collision_that_is_told(drift):
    """If gears kept their drift in the event, it would add up to 722 J; in the step they give way."""
    stepper = _hit([drift], 0.9)
    (event,) = stepper.events
    impact = event.impact
    assert impact.collision.bilateral_jacobian is None
    assert impact.post_contact_velocity == pytest.approx([0.9], rel=1e-9)
    assert impact.energy_change == pytest.approx(-0.5 * (1.0 - 0.81), rel=1e-9)
    assert stepper.sums.energy_change == pytest.approx(impact.energy_change, rel=1e-12)


def test_gears_that_drift_are_in_the_collision_that_is_told_where_they_do_not_drive_it():
    """With e = 0.5 a drift of 8 % returns a part of the lost energy; the drift of the other pair drives its event."""
    stepper = _hit([0.08, 1.0], 0.5)
    (event,) = stepper.events
    gears = event.impact.collision.bilateral_jacobian
    assert gears is not None
    np.testing.assert_allclose(np.abs(gears / np.abs(gears).max()), [[1.0, 0.05, 0.0, 0.0]], atol=1e-12)
    first = 0.5 * (0.5**2 + (0.5 * 20.0 + 1.6) ** 2 - 1.0 - 18.4**2)
    assert event.impact.energy_change == pytest.approx(first - 0.5 * 0.75, rel=1e-9)
    assert stepper.sums.energy_change == pytest.approx(event.impact.energy_change, rel=1e-12)


def test_a_limit_that_a_constraint_locks_is_told_without_it_and_without_what_forces_do_elsewhere():
    """No impulse opens a locked limit; if the step meets its law all the same, the event is without the constraint."""
    slides = "".join(
        f'<body pos="0 {i} 0"><joint name="{name}" type="slide" axis="1 0 0" {more}/><geom size=".1" mass="1"/></body>'
        for i, (name, more) in enumerate([("locked", 'range="-.001 1"'), ("driven", "")])
    )
    rest = '<equality><joint joint1="locked"/></equality><actuator><motor joint="driven"/></actuator>'
    model, data = compile_scene(slides, rest, option='gravity="0 0 0" timestep=".002"')
    data.qvel[0], data.ctrl[0] = -1.0, 1e4
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    stepper.step(data)
    (event,) = stepper.events
    assert stepper.shortfall < 1e-9
    assert event.impact.post_contact_velocity == pytest.approx([0.5], rel=1e-9)
    assert event.impact.energy_change == pytest.approx(-0.5 * 0.75, rel=1e-9)
    assert not event.projected
    assert stepper.sums.energy_change == pytest.approx(event.impact.energy_change, rel=1e-12)


def _both_hit(law, drift):
    """Return v+ of such gears after both hit a limit, the energy before and after, and the impact."""
    bodies, coupling = _geared(0)
    bodies = bodies.replace('name="geared0" type="slide"', 'name="geared0" range="0 9" type="slide"')
    model, data = compile_scene(bodies, f"<equality>{coupling}</equality>", option='gravity="0 0 0" timestep=".002"')
    data.qvel[:] = before = -1.0, -20.0 + 20.0 * drift
    stepper = Stepper(model, law, scheme="time-stepping")
    stepper.step(data)
    (event,) = stepper.events
    return data.qvel, 0.5 * np.dot(before, before), 0.5 * np.dot(data.qvel, data.qvel), event.impact


@pytest.mark.parametrize("drift", [0.2, 0.5])
def test_gears_that_give_way_do_not_drive_the_collision_that_a_law_is_asked_about(drift):
    """Poisson's law is asked about the whole collision; with equal coefficients its outcome is Moreau's."""
    after, _, _, impact = _both_hit(Poisson(0.9), drift)
    np.testing.assert_allclose(after, [0.9, 18.0 * (1.0 - drift)], rtol=1e-9)
    np.testing.assert_allclose(impact.post_velocity, after, rtol=1e-9)


@pytest.mark.parametrize("drift", [0.05, 0.2, 0.5])
def test_gears_do_not_drive_a_collision_whose_law_is_scaled(drift):
    """With full restitution this law creates 4 900 J, of which gears take a part; without it the gears add energy."""
    _, before, after, impact = _both_hit(Fremond([[0.5, 0.3], [0.3, 0.5]]), drift)
    assert after < before * (1.0 + 1e-2)
    assert impact.energy_change < 1e-2 * before
