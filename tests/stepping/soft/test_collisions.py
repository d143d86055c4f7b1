"""Soft stepping with collisions: the law exactly at each one, MuJoCo in between, divergence noticed."""

import copy

import mujoco
import numpy as np
import pytest
from scenes import INTEGRATORS, run

from impactlaw import MaximalDissipation, Moreau, Newton, Poisson, Stepper
from impactlaw.errors import DivergenceError, SceneError, UnknownNameError

BALL = """
<mujoco>
  <option timestep="0.001" integrator="{integrator}"><flag energy="enable"/></option>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 .5">
      <joint name="z" type="slide" axis="0 0 1"/><geom name="ball" type="sphere" size=".1" mass="1"/>
    </body>
  </worldbody>
  <sensor><jointvel joint="z"/></sensor>
</mujoco>
"""
RESTING = '<body pos=".5 0 .0999"><joint type="slide" axis="0 0 1"/><geom type="sphere" size=".1"/></body>'
HEAP = """
<mujoco>
  <option timestep="0.002" integrator="{integrator}"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body pos="0 0 .4" euler="20 30 0"><freejoint/><geom type="box" size=".1 .15 .05"/></body>
    <body pos=".05 0 .7" euler="50 10 0"><freejoint/><geom type="capsule" size=".05 .1"/></body>
    <body pos="0 .1 1.0"><freejoint/><geom type="sphere" size=".08" density="200"/></body>
    <body pos="-.05 0 1.3" euler="0 45 0"><freejoint/><geom type="cylinder" size=".08 .06"/></body>
  </worldbody>
</mujoco>
"""

CHAIN = """<mujoco><option timestep="{h}" integrator="RK4"><flag energy="enable" contact="disable"/></option><worldbody>
  <body pos="0 0 1"><joint type="ball" range="0 50"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
  <body pos="0 0 -.4"><joint type="ball" pos="0 .1 .05"/><geom type="ellipsoid" size=".07 .06 .05"/></body></body>
  </worldbody></mujoco>"""
"""Two links, the first one with a limit."""


def build(xml, **options):
    model = mujoco.MjModel.from_xml_string(xml.format(**options))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9, 1.0])
def test_bouncing_ball(integrator, e):
    """Every collision returns e times the speed, from which MuJoCo continues."""
    model, data = build(BALL, integrator=integrator)
    stepper = Stepper(model, Moreau(e), contact_model="soft")
    speeds = []
    for _ in range(1500):
        stepper.step(data)
        for event in stepper.events:
            pre, post = event.impact.collision.pre_velocity[0], event.impact.post_velocity[0]
            assert event.contacts.labels == ("floor/ball",)
            assert post == pytest.approx(-e * pre, rel=1e-15, abs=1e-15)
            assert event.impact.violations.is_admissible()
            if event.time < data.time:  # the velocity stage and sensors use the velocity after the collision
                assert data.sensordata[0] == post
                assert data.energy[1] == pytest.approx(0.5 * post**2, rel=1e-14)
            else:
                assert integrator == "RK4"
                assert data.qvel[0] == post
                assert data.xpos[1, 2] == data.qpos[0] + 0.5
            speeds.append(-pre)
    assert len(speeds) >= (1 if e == 0 else 2)
    assert speeds[0] == pytest.approx(np.sqrt(2 * 9.81 * 0.4), rel=0.005)
    if e > 0:
        assert speeds[1] == pytest.approx(e * speeds[0], rel=0.02)


@pytest.mark.parametrize("timestep", [0.002, 0.005, 0.01])
@pytest.mark.parametrize("e", [0.5, 1.0])
@pytest.mark.parametrize("beside", ["", RESTING], ids=["alone", "beside a contact"])
def test_rk4_does_not_look_ahead_into_a_collision(timestep, e, beside):
    """The soft force of RK4's later stages would turn e = 1 into an effective 0.6 at 5 ms."""
    model, data = build(BALL.replace("</worldbody>", beside + "</worldbody>"), integrator="RK4")
    model.opt.timestep = timestep
    stepper = Stepper(model, Moreau(e), contact_model="soft")
    while not stepper.events:
        stepper.step(data)
    before, after = stepper.events[0].impact.collision.pre_velocity[0], []
    assert before == pytest.approx(-np.sqrt(2 * 9.81 * (0.4 - data.qpos[0] - 0.4)), rel=0.01)
    for _ in range(5):
        stepper.step(data)
        assert stepper.events == ()
        after.append(data.qvel[0] + 9.81 * timestep * (len(after) + 1))
    assert after[-1] == pytest.approx(-e * before, rel=0.03)


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize(
    "joint",
    [
        'axis="0 0 1" pos="0 0 0"/><geom size=".1"/>',
        'axis="0 0 1" range="1e-7 9"/><geom size=".1" contype="0" conaffinity="0"/>',
    ],
)
def test_rk4_does_not_look_ahead_into_a_collision_while_another_contact_opens(joint, compiled):
    """There are as many contacts and limits at the end of the step as at its start, but different ones."""
    rising = f'<body pos=".5 0 .0999999"><joint type="slide" {joint}</body>'
    model, data = build(BALL.replace("</worldbody>", rising + "</worldbody>"), integrator="RK4")
    model.opt.timestep = 0.01
    data.qpos[0], data.qvel[:] = -0.395, (-2.0, 1.0)
    stepper = Stepper(model, Moreau(1), contact_model="soft", compiled=compiled)
    assert [event.contacts.labels for event in run(stepper, data, 1)] == [("floor/ball",)]
    assert data.qvel[0] == pytest.approx(2.0, abs=0.11)


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_rk4_does_not_look_ahead_into_a_limit_while_that_of_a_tendon_opens(compiled):
    """Joint and tendon are both the first of their kind, so that their limits have the same id."""
    limited = BALL.replace('name="z"', 'name="z" range="-.39 9"')
    rising = """<body pos=".5 0 1"><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody>
        <tendon><fixed range="1e-7 9"><joint joint="up" coef="1"/></fixed></tendon>"""
    model, data = build(limited.replace("</worldbody>", rising), integrator="RK4")
    model.opt.timestep = 0.01
    data.qpos[0], data.qvel[:] = -0.378, (-2.0, 1.0)
    stepper = Stepper(model, Moreau(1), contact_model="soft", compiled=compiled)
    assert [event.contacts.labels for event in run(stepper, data, 1)] == [("z",)]
    assert data.qvel[0] == pytest.approx(2.0, abs=0.11)


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("h", [0.01, 0.005])
def test_rk4_is_left_in_a_step_that_ends_in_a_collision(h, compiled):
    """The chain turns by up to half a radian per step. Regression: such steps used Euler, and the chain diverged."""
    model = mujoco.MjModel.from_xml_string(CHAIN.format(h=h))
    data, alone = mujoco.MjData(model), copy.copy(model)
    data.qvel[:] = 6.0, 3.0, 5.0, 1.0, 2.0, 3.0
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    free, energy = mujoco.MjData(alone), []
    stepper, hits = Stepper(model, Moreau(1), contact_model="soft", compiled=compiled), 0
    for _ in range(round(3 / h)):
        free.qpos[:], free.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, free)
        touches = free.nl
        energy.append(free.energy.sum())
        stepper.step(data)
        mujoco.mj_step(alone, free)
        if stepper.events and not touches:
            hits += 1
            np.testing.assert_array_equal(data.qpos, free.qpos)
            np.testing.assert_array_equal(stepper.events[0].impact.collision.pre_velocity, free.qvel)
    assert hits > 20
    assert max(energy - np.minimum.accumulate(energy)) < 0.05 * energy[0]


def test_a_meeting_in_free_space():
    """Only the law acts between two balls: e = 1 exchanges their velocities."""
    xml = """<mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody>
      <body name="a" pos="0 0 0"><joint type="slide" axis="1 0 0"/><geom type="sphere" size=".1" mass="1"/></body>
      <body name="b" pos=".201 0 0"><joint type="slide" axis="1 0 0"/><geom type="sphere" size=".1" mass="1"/></body>
    </worldbody></mujoco>"""
    model, data = build(xml)
    data.qvel[:] = 2.0, 0.0
    (event,) = run(Stepper(model, Moreau(1.0), contact_model="soft"), data, 20)
    assert event.contacts.labels == ("a/b",)
    np.testing.assert_allclose(event.impact.post_velocity, (0.0, 2.0), atol=1e-14)
    np.testing.assert_allclose(data.qvel, (0.0, 2.0), atol=0.05)


def test_a_box_that_falls_flat_collides_once_with_four_contacts():
    model, data = build(
        """<mujoco><option timestep="0.001"/><worldbody><geom type="plane" size="1 1 1"/>
        <body name="box" pos="0 0 .2"><freejoint/><geom type="box" size=".1 .1 .05"/></body></worldbody></mujoco>"""
    )
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    while not stepper.events:
        stepper.step(data)
    (event,) = stepper.events
    impulse = event.impact.impulse
    np.testing.assert_allclose(impulse, np.full(4, impulse.mean()), rtol=1e-9)
    np.testing.assert_allclose(event.impact.post_velocity, -0.5 * event.impact.collision.pre_velocity, atol=1e-12)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("law", [MaximalDissipation(), Moreau(0.5), Moreau(0.9), Newton(0.7)], ids=repr)
@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_every_collision_of_a_heap_is_admissible(compiled, integrator, law):
    """Events of compiled steps have exact velocities; on faces their impulses are fitted to these."""
    model, data = build(HEAP, integrator=integrator)
    events = run(Stepper(model, law, contact_model="soft", compiled=compiled), data, 600)
    assert len(events) > 10
    for event in events:
        assert event.impact.violations.is_admissible()
        assert event.impact.residual < (1e-9 if compiled == "never" else 1e-7)
        assert event.impact.collision.pre_contact_velocity.max() <= 0.01
        assert event.impact.collision.pre_contact_velocity.min() < -0.1
    assert np.isfinite(data.qpos).all()


@pytest.mark.parametrize("contact_model", ["rigid", "soft"])
def test_a_law_for_the_wrong_contacts(contact_model):
    model, _ = build(BALL.replace("geom name", 'geom condim="1" name'), integrator="Euler")
    with pytest.raises(UnknownNameError, match=r"'ball/flor'.*'floor/ball'"):
        Stepper(model, Newton({("ball", "flor"): 0.5}), contact_model=contact_model)
    Stepper(model, Newton({("ball", "floor"): 0.5}), contact_model=contact_model)


# -- divergence ----------------------------------------------------------------------------------------------------


def break_qpos(data):
    data.qpos[0] = np.nan


def break_qvel(data):
    data.qvel[0] = -np.inf


def break_qacc(data):
    data.qfrc_applied[0] = 1e300


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("break_it", [break_qpos, break_qvel, break_qacc])
@pytest.mark.parametrize("steps", [0, 1, 50])
@pytest.mark.parametrize("autoreset", [True, False])
def test_divergence_is_seen(integrator, break_it, steps, autoreset):
    model, data = build(BALL, integrator=integrator)
    if not autoreset:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    for _ in range(2):  # also after a reset
        mujoco.mj_resetData(model, data)
        for _ in range(steps):
            stepper.step(data)
        break_it(data)
        with pytest.raises(DivergenceError, match=rf"not finite.* t = {data.time:g} s"):
            stepper.step(data)


@pytest.mark.usefixtures("quiet")
@pytest.mark.parametrize("steps", [0, 50])
def test_divergence_is_seen_in_the_second_half(steps):
    model, data = build(BALL, integrator="Euler")
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    for _ in range(steps):
        stepper.step(data)
    mujoco.mj_step1(model, data)
    break_qacc(data)
    with pytest.raises(DivergenceError, match="not finite"):
        stepper.finish_step(data)


def test_rigid_steps_have_no_halves():
    model, data = build(BALL.replace("geom name", 'geom condim="1" name'), integrator="Euler")
    with pytest.raises(SceneError, match="soft"):
        Stepper(model, Moreau(0.5)).finish_step(data)


@pytest.mark.parametrize("options", [{"law": Poisson(0.5)}, {"law": Moreau(0.5), "contacts": "*"}], ids=["law", "some"])
@pytest.mark.parametrize("landing", [1, 100])
def test_boxes_bounce_whatever_others_there_are(options, landing):
    """A collision of one box takes milliseconds in Python: other boxes must neither use up nor share its work."""
    boxes = "".join(
        f'<body pos="{0.3 * i} 0 {5.0 if i >= landing else 0.1001}"><freejoint/>'
        '<geom type="box" size=".1 .1 .1" mass="1"/></body>'
        for i in range(100)
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody><geom type="plane" size="99 99 1"/>'
        f"{boxes}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    falling = data.qvel.reshape(-1, 6)[:landing, 2]
    falling[:] = -1.0
    stepper = Stepper(model, contact_model="soft", **options)
    for _ in range(3):
        stepper.step(data)
    np.testing.assert_allclose(falling, 0.5, atol=1e-9)
    assert stepper.short_steps == 0
