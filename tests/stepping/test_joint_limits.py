"""Limits of joints and tendons are contacts: exact bounces, rest, several at once, restitution, rigid and soft."""

import math
from functools import partial

import mujoco
import numpy as np
import pytest
import scenes
from scenes import assert_steps_of_mujoco, run

from impactlaw import Collision, Moreau, Newton, Stepper, read_contacts
from impactlaw.errors import OverlapError, UnknownNameError
from impactlaw.scene.contacts import update_positions
from impactlaw.scene.detection import Detector

SLIDE = '<body name="cart"><joint name="rail" type="slide" axis="1 0 0" range="-1 2"/><geom size=".1" mass="3"/></body>'
HINGE = '<body><joint name="knee" axis="0 1 0" range="-40 60"/><geom size=".1" pos="0 0 -.5"/></body>'


compiled = partial(scenes.compiled, option='gravity="0 0 0" timestep="0.01" integrator="RK4"')


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "discrete", "RK4"])
def test_a_cart_bounces_between_the_ends_of_its_rail(e, integrator):
    model, data = compiled(SLIDE, option=f'gravity="0 0 0" timestep="0.05" integrator="{integrator}"')
    data.qvel[0] = 3.7
    events = run(Stepper(model, Moreau(e)), data, 60)
    times, time, speed, target = [], 2.0 / 3.7, 3.7, 2.0
    while time < 3.0:
        times.append(time)
        speed *= e
        if speed == 0:
            break
        time += 3.0 / speed
        target = -1.0 if target == 2.0 else 2.0
    assert [event.time for event in events] == pytest.approx(times, abs=1e-9)
    assert {event.contacts.labels for event in events} == {("rail",)}
    assert all(abs(event.contacts.gap[0]) <= 1e-9 for event in events)
    if e == 0:
        assert data.qpos[0] == pytest.approx(2.0, abs=1e-9)
        assert data.qvel[0] == pytest.approx(0.0, abs=1e-12)


def test_a_pendulum_bounces_on_its_limits_and_keeps_its_energy():
    model, data = compiled(HINGE, option='timestep="0.002" integrator="RK4"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data.qvel[0] = 6.0
    mujoco.mj_forward(model, data)
    before = data.energy.sum()
    events = run(Stepper(model, Moreau(1)), data, 1000)
    mujoco.mj_forward(model, data)
    assert len(events) >= 4
    assert data.energy.sum() == pytest.approx(before, rel=1e-8)
    for event in events:
        assert min(abs(event.qpos[0] - model.jnt_range[0])) <= 1e-9


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_what_leans_on_a_limit_rests_there(integrator):
    """A pendulum held up by its upper limit: no gap, no events once it is at rest, no drift."""
    model, data = compiled(HINGE, option=f'timestep="0.005" integrator="{integrator}" gravity="-9.81 0 0"')
    stepper = Stepper(model, Moreau(0.3))
    run(stepper, data, 1000)
    assert run(stepper, data, 300) == []
    assert data.qpos[0] == pytest.approx(math.radians(60), abs=2e-9)
    assert abs(data.qvel[0]) < 1e-9


def test_a_ball_joint_bounces_at_its_angle():
    world = '<body><joint name="hip" type="ball" range="0 30"/><geom type="box" size=".1 .2 .3"/></body>'
    model, data = compiled(world)
    data.qvel[:] = 0.0, 2.0, 0.0
    (event,) = run(Stepper(model, Moreau(0.5)), data, 30)
    assert event.contacts.labels == ("hip",)
    assert event.time == pytest.approx(math.radians(30) / 2.0, abs=1e-9)
    assert data.qvel == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    "options", [{}, {"contact_model": "soft"}, {"contact_model": "soft", "compiled": "never"}], ids=str
)
def test_a_ball_joint_that_spins_keeps_its_energy_under_rk4(options):
    """Each bounce conserves energy, about any axis, and so does RK4 between bounces, where Euler diverges."""
    link = '<body pos="0 0 1"><joint type="ball" range="0 50"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>'
    model, data = compiled(link + "</body>", option='timestep="0.01" integrator="RK4"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    stepper, energies, other = Stepper(model, Moreau(1), **options), [], mujoco.MjData(model)
    data.qvel[:] = 6.0, 3.0, 5.0
    bounces = 0
    for _ in range(300):
        other.qpos[:], other.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, other)
        energies.append(other.energy.sum())
        stepper.step(data)
        for event in stepper.events:
            bounces += 1
            impact = event.impact
            assert impact.post_contact_velocity == pytest.approx(-impact.collision.pre_contact_velocity, rel=1e-9)
            assert abs(impact.energy_change) < 1e-12 * energies[0]
    assert bounces > 15
    assert max(energies - np.minimum.accumulate(energies)) < 2e-4 * energies[0]


def test_a_string_becomes_taut():
    """A mass on a string of length 2 flies off: only its radial velocity is reversed."""
    world = """<site name="hook"/>
        <body name="mass" pos="1.2 0 0"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <geom size=".1" mass="2"/><site name="mass"/></body>"""
    rest = '<tendon><spatial name="string" range="0 2"><site site="hook"/><site site="mass"/></spatial></tendon>'
    model, data = compiled(world, rest)
    data.qvel[:] = 0.0, 4.0
    (event,) = run(Stepper(model, Moreau(0.5)), data, 50)
    assert event.contacts.labels == ("string",)
    assert event.time == pytest.approx(1.6 / 4.0, abs=1e-9)  # sides 1.2, 1.6, 2
    radial, tangential = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    assert data.qvel @ radial == pytest.approx(-0.5 * 3.2, abs=1e-8)
    assert data.qvel @ tangential == pytest.approx(2.4, abs=1e-8)


@pytest.mark.parametrize("options", scenes.WAYS.values())
@pytest.mark.parametrize(("start", "beside"), [(-0.3, 1e-3), (-0.3, 0.0), (0.0, 0.0)])
def test_a_rope_is_slack_where_its_ends_pass_each_other(options, start, beside):
    """Its length is never below its lower limit, 0, but grows again: the body goes on until the rope is taut."""
    body = f"""<site name="post" pos="0 {beside} 0"/><body pos="{start} 0 0"><joint type="slide" axis="1 0 0"/>
      <geom size=".02" mass="1" contype="0" conaffinity="0"/><site name="end"/></body>"""
    rope = '<tendon><spatial limited="true" range="0 .5"><site site="post"/><site site="end"/></spatial></tendon>'
    model, data = compiled(body, rope, option='gravity="0 0 0" timestep="0.002" integrator="RK4"')
    data.qvel[0] = 2.0
    events = run(Stepper(model, Moreau(0.5), **options), data, round((0.55 - start) / 2.0 / 0.002))
    assert len(events) == 1
    assert data.qvel[0] == pytest.approx(-1.0, abs=1e-9)
    assert 0.4 < start + data.qpos[0] < 0.5
    assert model.tendon_range.tolist() == [[0.0, 0.5]]


def test_a_fixed_tendon_couples_two_carts():
    """q1 + q2 <= 1: masses 1 and 3, both at 1 m/s; the impulse of the limit is the same on both."""
    world = "".join(
        f'<body pos="0 {y} 0"><joint name="{name}" type="slide" axis="1 0 0"/>'
        f'<geom size=".1" mass="{mass}" condim="1"/></body>'
        for name, y, mass in (("one", 0, 1), ("two", 1, 3))
    )
    couple = '<joint joint="one" coef="1"/><joint joint="two" coef="1"/>'
    model, data = compiled(world, f'<tendon><fixed name="sum" range="-5 1">{couple}</fixed></tendon>')
    data.qvel[:] = 1.0, 1.0
    (event,) = run(Stepper(model, Moreau(1)), data, 60)
    assert event.time == pytest.approx(0.5, abs=1e-9)
    assert event.impact.impulse == pytest.approx([3.0])  # 2 * 2 / (1/1 + 1/3)
    assert data.qvel == pytest.approx([-2.0, 0.0], abs=1e-9)


def test_limit_and_contact_collide_at_once():
    """A ball is shot at one that touches it and leans on the end of its rail: the chain ends at a wall."""
    world = "".join(
        f'<body pos="{x} 0 0"><joint name="{name}" type="slide" axis="1 0 0" {limit}/>'
        f'<geom name="{name}" size=".5" mass="1" condim="1"/></body>'
        for name, x, limit in (("left", 0, ""), ("right", 1, 'range="-1 0"'))
    )
    model, data = compiled(world)
    data.qvel[:] = 1.0, 0.0
    collision = Collision.from_mujoco(model, data)
    assert collision.labels == ("left/right", "right")
    assert collision.jacobian == pytest.approx(np.array([[-1.0, 1.0], [0.0, -1.0]]))
    assert Moreau(1).resolve(collision).post_velocity == pytest.approx([-1.0, 0.0])
    impact = Newton({("left", "right"): 0.5, "right": 1.0}).resolve(collision)
    assert impact.post_velocity == pytest.approx([-0.5, 0.0])
    stepper = Stepper(model, Moreau(1))
    stepper.step(data)
    (event,) = stepper.events
    assert event.contacts.labels == ("left/right", "right")
    assert event.impact.impulse == pytest.approx([2.0, 2.0])
    assert data.qvel == pytest.approx([-1.0, 0.0])


def test_scene_restitution_of_a_joint():
    custom = '<custom><numeric name="restitution" data="1"/><numeric name="restitution/rail" data="0.25"/></custom>'
    model, data = compiled(SLIDE, custom)
    data.qvel[0] = 3.0
    run(Stepper(model, "scene"), data, 80)
    assert data.qvel[0] == pytest.approx(-0.75)


def test_a_joint_without_limit_has_no_restitution():
    custom = '<custom><numeric name="restitution/wheel" data="0.25"/></custom>'
    model, _ = compiled('<body><joint name="wheel"/><geom size=".1"/></body>' + SLIDE, custom)
    with pytest.raises(UnknownNameError, match="rail"):
        Stepper(model, "scene")
    with pytest.raises(UnknownNameError, match="rail"):
        Stepper(model, Newton({"rial": 0.5}, default=1.0))


def test_a_start_beyond_a_limit_is_named():
    model, data = compiled(SLIDE)
    data.qpos[0] = 2.25
    with pytest.raises(OverlapError, match=r"rail by 0\.25"):
        Stepper(model, Moreau(1)).step(data)


def test_limits_that_are_switched_off_stay_off():
    model, data = compiled(SLIDE, option='gravity="0 0 0" timestep="0.01"')
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    data.qvel[0] = 3.0
    assert run(Stepper(model, Moreau(1)), data, 100) == []
    assert data.qpos[0] == pytest.approx(3.0)


def test_margins_and_options_are_the_users_again():
    model, data = compiled(SLIDE)
    model.jnt_margin[:] = 0.125
    flags = model.opt.disableflags, model.opt.enableflags, model.opt.o_margin
    data.qvel[0] = 3.0
    run(Stepper(model, Moreau(1)), data, 90)
    assert model.jnt_margin[0] == 0.125
    assert (model.opt.disableflags, model.opt.enableflags, model.opt.o_margin) == flags


def test_read_contacts_tells_a_limit():
    model, data = compiled(SLIDE)
    data.qpos[0] = -1.0
    contacts = read_contacts(model, data)
    assert contacts.labels == ("rail",)
    assert contacts.geoms.tolist() == [[-1, -1]]
    assert contacts.gap == pytest.approx([0.0])
    assert contacts.normal == pytest.approx(np.array([[1.0, 0.0, 0.0]]))
    assert len(read_contacts(model, data, within=3.5)) == 2


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("tendon", ["", '<tendon><fixed range="-9 9"><joint joint="j" coef="1"/></fixed></tendon>'])
def test_the_normal_of_a_limit_is_the_direction_in_which_its_gap_opens(kind, tendon):
    """Also where limits are read from MuJoCo's constraint rows, since a tendon has one."""
    body = f'<body><joint name="j" type="{kind}" axis="0 1 0" range="-1 1"/><geom size=".1" pos="0 0 -.5"/></body>'
    model, data = compiled(body, tendon)
    for side in (-1.0, 1.0):
        data.qpos[0] = side * model.jnt_range[0, 1]
        assert read_contacts(model, data).normal == pytest.approx(np.array([[0.0, -side, 0.0]]))


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "discrete", "RK4"])
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_soft_stepping_bounces_on_limits(integrator, e):
    """With a fine timestep the limit's own spring adds little: the rebound is that of the law."""
    model, data = compiled(SLIDE, option=f'gravity="0 0 0" timestep="2e-4" integrator="{integrator}"')
    data.qpos[0], data.qvel[0] = 1.9, 3.0
    stepper = Stepper(model, Moreau(e), contact_model="soft")
    events = run(stepper, data, 400)
    assert events[0].contacts.labels == ("rail",)
    assert events[0].impact.post_contact_velocity == pytest.approx([3.0 * e], abs=1e-6)
    assert data.qvel[0] == pytest.approx(-3.0 * e, abs=0.15)


def test_soft_steps_away_from_limits_are_those_of_mujoco():
    model, data = compiled(SLIDE + HINGE)
    reference = mujoco.MjData(model)
    for state in (data, reference):
        state.qvel[:] = 0.5, 0.5
    assert_steps_of_mujoco(Stepper(model, Moreau(1), contact_model="soft"), data, reference, 100)


def test_lower_and_upper_limit_are_told_apart():
    model, data = compiled(SLIDE)
    detector = Detector(model)
    keys = []
    for position in (-1.0, 2.0):
        data.qpos[0] = position
        update_positions(model, data)
        with detector.options:
            found = detector.look(data, 1e-6)
        assert found.contacts.labels == ("rail",)
        assert found.jacobian[0, 0] == (1.0 if position < 0 else -1.0)
        keys.append(int(found.pattern.key[0]))
    assert keys[0] != keys[1]
    with detector.options:
        pattern = detector.look(data, 10.0).pattern
    assert pattern.key.tolist() == keys
