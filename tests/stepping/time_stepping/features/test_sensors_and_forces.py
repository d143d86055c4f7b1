"""Sensors, constraint forces, energy and frames after a time step."""

import copy

import mujoco
import numpy as np
import pytest
from scenes import compiled, energy, run
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau, Stepper

G = 9.81


def falling(z=1.1):
    return f'<body pos="0 0 {z}"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="1"/></body>'


SENSED = (
    FLOOR
    + """<body name="b" pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="3"/>
    <site name="s" type="box" size=".11 .11 .11"/></body>"""
)
SENSORS = """<sensor><touch site="s"/><accelerometer site="s"/><velocimeter site="s"/><gyro site="s"/>
    <framelinacc objtype="body" objname="b"/></sensor>"""


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_a_resting_box_feels_its_weight(cone, jacobian, condim):
    option = f'cone="{cone}" jacobian="{jacobian}"'
    model, data = compiled(SENSED, SENSORS, option=option, geom=f'condim="{condim}"')
    run(stepping(model, Moreau(0.5)), data, 5)
    touch, acceleration, velocity = data.sensordata[0], data.sensordata[1:4], data.sensordata[4:10]
    assert touch == pytest.approx(3 * G, rel=1e-8)
    assert acceleration == pytest.approx([0, 0, G], abs=1e-7)
    assert velocity == pytest.approx(np.zeros(6), abs=1e-9)
    mujoco.mj_rnePostConstraint(model, data)
    assert data.cfrc_ext[1, 3:] == pytest.approx([0, 0, 3 * G], abs=1e-6)
    assert data.qfrc_constraint[2] == pytest.approx(3 * G, rel=1e-8)
    forces = np.zeros((data.ncon, 6))
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, forces[i])
    assert forces[:, 0].sum() == pytest.approx(3 * G, rel=1e-8)


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_a_box_that_slides_feels_friction(cone):
    model, data = compiled(SENSED, SENSORS, option=f'cone="{cone}"', geom='friction=".3"')
    data.qvel[0] = 5.0
    run(stepping(model, Moreau(0)), data, 20)
    assert data.sensordata[1:4] == pytest.approx([-0.3 * G, 0, G], abs=1e-6)
    assert data.sensordata[4] == pytest.approx(data.qvel[0], abs=0.3 * G * 0.002 + 1e-9)
    mujoco.mj_rnePostConstraint(model, data)
    assert data.cfrc_ext[1, 3:] == pytest.approx([-0.9 * G, 0, 3 * G], abs=1e-5)


NEAR = """<body name="near" pos="2 0 .17"><freejoint/><geom name="near" type="box" size=".1 .1 .1"/></body>"""
TOUCHES = """<sensor><contact geom1="near" data="found" num="1"/><contact geom1="box" data="found dist" num="1"/>
    <contact body1="b" data="found force" reduce="netforce"/>
    <contact geom1="near" data="found linvel" num="1"/></sensor>"""
cones = pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])


@cones
@pytest.mark.parametrize("order", [1, -1])
def test_contacts_that_are_near_but_open_are_not_listed(cone, order):
    model, data = compiled("".join((SENSED, NEAR)[::order]), TOUCHES, option=f'cone="{cone}"')
    data.joint(model.body("near").jntadr[0]).qvel[2] = -20.0  # m/s
    run(stepping(model, Moreau(0.5)), data, 1)
    assert (data.contact.geom == sorted([model.geom("box").id, 0])).all()
    assert data.ncon == 4
    assert (data.contact.dist < 1e-6).all()
    assert (data.contact.efc_address >= 0).all()
    assert data.sensordata[:2] == pytest.approx([0, 4])
    assert data.sensordata[3:7] == pytest.approx([4, 0, 0, -3 * G], abs=1e-7)
    assert (data.sensordata[7:] == 0.0).all()
    forces = np.zeros((4, 6))
    for i in range(4):
        mujoco.mj_contactForce(model, data, i, forces[i])
    assert forces[:, 0].sum() == pytest.approx(3 * G, rel=1e-8)
    address, count = data.contact.efc_address, 4 if cone == "pyramidal" else 3
    for i in range(4):
        assert (data.efc_id[address[i] : address[i] + count] == i).all()
    if cone == "pyramidal":
        assert data.nefc == 4 * 4


@cones
def test_a_ball_that_bounces_touches_when_it_collides(cone):
    """MuJoCo's list of contacts and a contact sensor tell the steps in which the ball collides, and no others."""
    ball = NEAR.replace('type="box" size=".1 .1 .1"', 'size=".1"')
    model, data = compiled(SENSED + ball, TOUCHES, option=f'cone="{cone}"')
    data.qvel[8] = -3.0  # m/s
    stepper, collisions, listed = stepping(model, Moreau(0.5)), 0, 0
    for _ in range(200):
        stepper.step(data)
        mine = np.flatnonzero((data.contact.geom == model.geom("near").id).any(axis=1))
        force = np.zeros(6)
        for i in mine:
            mujoco.mj_contactForce(model, data, i, force)
            assert force[0] > 0.0
        assert data.sensordata[0] == len(mine)
        collisions += stepper.sums.collisions
        listed += len(mine)
    assert listed == collisions == 2


@cones
def test_an_open_contact_that_pushes_by_rounding_is_not_listed(cone):
    """Regression: one corner of these boxes, .26 mm off, pushed its neighbour sideways with 1e-21 N, and was listed."""
    box = '<body pos="{} 0 {}" euler="{} 5 0"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    boxes = "".join(box.format(0.02 * i, 0.15 + 0.22 * i, 10 * i) for i in range(3))
    model, data = compiled(FLOOR + boxes, option=f'cone="{cone}" timestep=".004"')
    stepper, force = stepping(model, Moreau(0.5)), np.zeros(6)
    for _ in range(100):
        stepper.step(data)
        for i in np.flatnonzero(data.contact.dist > 1e-5):
            mujoco.mj_contactForce(model, data, i, force)
            assert force[0] > 0.0


def test_force_and_torque_sensors_of_a_held_arm():
    world = """<body name="base" pos="0 0 1"><body name="arm"><joint type="slide" axis="0 0 1" frictionloss="1e3"/>
        <geom size=".1" pos=".5 0 0" mass="2"/><site name="s"/></body></body>"""
    sensor = '<sensor><force site="s"/><torque site="s"/></sensor>'
    model, data = compiled(world, sensor)
    run(stepping(model, Moreau(0)), data, 3)
    assert data.sensordata[:3] == pytest.approx([0, 0, 2 * G], abs=1e-6)
    assert data.sensordata[4] == pytest.approx(-0.5 * 2 * G, abs=1e-6)


def test_limits_and_dry_friction_tell_their_forces():
    world = """<body><joint name="j" type="slide" axis="0 0 1" range="0 1"/><geom size=".1" mass="3"/></body>
        <body pos="2 0 0"><joint name="k" type="slide" axis="0 0 1" frictionloss="1e3"/>
        <geom size=".1" mass="3"/></body>"""
    model, data = compiled(world, '<sensor><jointlimitfrc joint="j"/></sensor>')
    run(stepping(model, Moreau(0)), data, 3)
    assert data.sensordata == pytest.approx([3 * G], rel=1e-8)
    assert data.qfrc_constraint == pytest.approx([3 * G, 3 * G], rel=1e-8)


def test_the_energy_of_tendons_is_that_of_the_end():
    """A spring, and a tendon with inertia, whose lengths the step evaluates at its midpoint."""
    world = """<site name="hook" pos="1 0 1"/><body><joint axis="0 1 0"/><geom size=".05" pos=".3 0 0" mass="1"/>
        <site name="tip" pos=".3 0 0"/></body>"""
    rest = """<tendon><spatial stiffness="30" armature=".5"><site site="tip"/><site site="hook"/></spatial></tendon>"""
    model, data = compiled(world, rest)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data.qvel[0] = 2.0
    run(stepping(model, Moreau(0.5)), data, 50)
    assert data.energy.sum() == pytest.approx(energy(model, copy.copy(data)), abs=1e-9)


def test_the_energy_flag_is_respected():
    model, data = compiled(FLOOR + falling(), geom='condim="1"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    stepper = stepping(model, Moreau(1))
    for _ in range(300):
        stepper.step(data)
        assert data.energy == pytest.approx([G * (data.qpos[0] + 1.1), 0.5 * data.qvel[0] ** 2], abs=1e-9)


def test_sensors_of_energy_are_of_the_middle_of_the_step():
    """Also where the energy was computed before, by the flag or by `mj_forward`."""
    link = '<body pos="{}"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".02"/>'
    pendulum = f"{link.format('0 0 2')}{link.format('.5 0 0')}</body></body>"
    model, data = compiled(FLOOR + pendulum, "<sensor><e_potential/><e_kinetic/></sensor>", option='timestep=".01"')
    seen = {}
    for enabled in (False, True):
        model.opt.enableflags = int(mujoco.mjtEnableBit.mjENBL_ENERGY) * enabled
        data, sensed = mujoco.MjData(model), []
        stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
        data.qvel[:] = 1.0, -2.0
        for _ in range(4):
            mujoco.mj_forward(model, data)
            stepper.step(data)
            sensed.append(data.sensordata.copy())
        seen[enabled] = np.array(sensed)
    assert np.ptp(seen[False], axis=0).min() > 0.01
    assert seen[True] == pytest.approx(seen[False], abs=1e-12)


def test_frames_are_current_after_a_step():
    model, data = compiled(FLOOR + falling() + '<body name="m" mocap="true" pos="3 0 0"/>')
    data.mocap_pos[0] = 3, 1, 2
    run(stepping(model, Moreau(1)), data, 30)
    assert data.body(1).xpos[2] == pytest.approx(data.qpos[0] + 1.1, abs=1e-12)
    assert data.body("m").xpos == pytest.approx([3, 1, 2], abs=1e-12)


def test_acceleration_is_the_change_of_velocity():
    model, data = compiled(FLOOR + falling(0.12), geom='condim="1"')
    stepper = stepping(model, Moreau(0.5))
    for _ in range(50):
        before = data.qvel.copy()
        stepper.step(data)
        assert data.qacc == pytest.approx((data.qvel - before) / model.opt.timestep, rel=1e-9, abs=1e-9)
