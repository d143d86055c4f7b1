"""Sensors of accelerations and momenta show the current step, whatever the last one has left."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

SCENE = """<mujoco><worldbody><geom type="plane" size="5 5 1"/>
  <body name="box" pos="0 0 .5"><freejoint/><geom type="box" size=".1 .2 .1" mass="2"/><site name="s"/></body>
  </worldbody>
  <sensor><accelerometer site="s"/><subtreelinvel body="box"/><force site="s"/></sensor></mujoco>"""


@pytest.mark.parametrize("asked", [False, True])
def test_sensors_are_those_of_this_step(asked):
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.qvel[:] = [1, 0, 0, 3, 2, 1]
    if asked:  # from then on MuJoCo takes these results for valid
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        mujoco.mj_subtreeVel(model, data)
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for _ in range(100):
        before = data.qvel[:3].copy()
        stepper.step(data)
        np.testing.assert_allclose(data.sensordata[:3], 0.0, atol=0.02)  # free fall with rotation: of first order
        np.testing.assert_allclose(data.sensordata[3:6], before, atol=1e-12)
    while data.time < 4.0:
        stepper.step(data)
    np.testing.assert_allclose(np.linalg.norm(data.sensordata[:3]), 9.81, rtol=1e-6)  # it is at rest
    np.testing.assert_allclose(data.sensordata[3:6], 0.0, atol=1e-9)


ROPE = """<mujoco><worldbody><site name="o" pos="0 0 2"/>
  <body pos="0 0 1.1"><freejoint/><geom size=".1" mass="2"/><site name="s"/></body></worldbody>
  <tendon><spatial name="t" limited="true" range=".1 .9"><site site="o"/><site site="s"/></spatial></tendon>
  <sensor><tendonlimitfrc tendon="t"/><tendonlimitpos tendon="t"/></sensor></mujoco>"""
"""A weight on a rope, held by the upper limit of its length."""

FLAP = """<mujoco><compiler angle="radian"/><worldbody><body><joint name="j" axis="0 1 0" range="-1 .3"/>
  <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".3"/></body></worldbody>
  <sensor><jointlimitfrc joint="j"/><jointlimitpos joint="j"/></sensor></mujoco>"""
"""A flap held at its upper limit by its weight."""


@pytest.mark.parametrize("scene", [ROPE, FLAP], ids=["rope", "flap"])
def test_sensors_of_limits_see_the_limit_that_holds(scene):
    model = mujoco.MjModel.from_xml_string(scene)
    theirs, data = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for _ in range(1500):
        mujoco.mj_step(model, theirs)
        stepper.step(data)
    assert data.sensordata[0] == pytest.approx(theirs.sensordata[0], rel=2e-3)
    assert abs(data.sensordata[1]) < 1e-6


def test_sensors_of_limits_that_are_far_say_nothing():
    model = mujoco.MjModel.from_xml_string(FLAP)
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    Stepper(model, Moreau(0.0), scheme="time-stepping").step(data)
    assert (data.sensordata == 0.0).all()
