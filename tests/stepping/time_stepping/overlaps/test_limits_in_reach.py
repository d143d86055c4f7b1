"""Steps compute only limits of joints within reach; a limit that a collision throws a link at is not passed."""

import mujoco
import numpy as np
import pytest
from stepping.time_stepping.stepped import on_a_tendon

from impactlaw import Batch, Moreau, Stepper

_SCENE = """<mujoco><compiler angle="radian"/><option timestep="0.01" gravity="0 0 0"/><worldbody>
  <body><joint name="paddle" type="hinge" axis="0 1 0" limited="true" range="-0.004 0.004"/>
    <geom type="capsule" fromto="0 0 0 0 0 -1" size=".02" mass="0.01"/></body>
  <body pos="-0.13 0 -0.9"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="10"/></body></worldbody></mujoco>"""


def _struck(scene: str = _SCENE) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a light paddle at rest that a heavy ball is about to strike and throw against its limit at once."""
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    data.qvel[1] = 2.0
    return model, data


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_limit_that_was_left_out_acts_as_if_it_had_not_been(restitution):
    model, one = _struck()
    alike, other = _struck(on_a_tendon(_SCENE, "paddle", "-0.004 0.004"))
    fast, plain = (Stepper(scene, Moreau(restitution), scheme="time-stepping") for scene in (model, alike))
    for _ in range(20):
        fast.step(one)
        plain.step(other)
        np.testing.assert_allclose(one.qpos, other.qpos, atol=1e-10)
        np.testing.assert_allclose(one.qvel, other.qvel, atol=1e-9)


def test_link_that_contact_throws_comes_to_rest_at_its_limit_in_many_worlds_too():
    model, data = _struck()
    batch = Batch(model, Moreau(0.0), nsim=3)
    batch.bind("qvel")[:] = data.qvel
    for _ in range(10):
        batch.step()
        assert np.abs(batch.bind("qpos")[:, 0]).max() < 0.004 + 2e-6
    assert np.abs(batch.bind("qvel")).max() < 1e-9


_PUSHED = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>
  <body mocap="true" pos="0 0 -.03"><geom type="box" size=".1 .1 .03"/></body>
  <body><joint type="slide" axis="0 0 1" limited="true" range="-1 .0103"/><geom size=".02" condim="1"/></body>
  </worldbody></mujoco>"""


def test_what_opens_an_overlap_does_not_pass_a_limit_that_was_left_out():
    model = mujoco.MjModel.from_xml_string(_PUSHED)
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    data, opened = mujoco.MjData(model), []
    for k in range(14):
        data.mocap_pos[0, 2] = -0.03 + 1e-5 * k
        stepper.step(data)
        opened.append(data.qpos[0])
    assert max(opened) <= 0.0103
    assert opened[-1] > 0.0102


_LINKAGE = """<mujoco><option timestep="0.002" gravity="0 0 0"/><default><geom contype="0" conaffinity="0"/></default>
  <worldbody><body pos="0 9 0"><joint name="push" type="slide" axis="1 0 0" range="-1 .01"/><geom size=".1"/></body>
  <body><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size=".02"/>
  <body name="end" pos="0 0 -1"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 1 0 0" size=".02"/></body>
  </body></worldbody><equality><connect body1="end" body2="world" anchor="1 0 0"/></equality>
  <actuator><motor joint="push"/></actuator></mujoco>"""


def test_linkage_turns_on_where_another_joint_is_driven_past_a_limit_that_was_left_out():
    """The slide does not influence the linkage, but its limit is found only in the middle of the step."""
    model = mujoco.MjModel.from_xml_string(_LINKAGE)
    ends = []
    for force in (2e4, 0.0):
        data = mujoco.MjData(model)
        data.qvel[1:] = 20.0, -40.0
        data.ctrl[:] = force
        Stepper(model, Moreau(0.0), scheme="time-stepping").step(data)
        ends.append(data.qvel[1:].copy())
    np.testing.assert_allclose(*ends, rtol=1e-10)


def test_a_limit_counts_though_the_opening_of_an_overlap_leads_away_from_it():
    """Regression: the hinge did not collide where ball joints beyond their limits moved it back within the step."""
    scene = """<mujoco><compiler angle="radian"/><option timestep="0.002"/><worldbody>
        <body><freejoint/><geom size=".08" mass="5"/>
        <body pos="0 .1 0"><joint type="ball" limited="true" range="0 .014"/>
        <geom size=".02" pos="0 -.07 -.05" mass=".3"/>
        <body pos="0 .1 -.05"><joint type="ball" limited="true" range="0 .014"/>
        <geom type="capsule" size=".03" fromto="0 0 0 0 .17 -.06" mass=".02"/>
        <body pos="0 0 .1"><joint name="hinge" axis="1 0 -1" limited="true" range="-.014 .014"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .14 -.14 0" mass=".04"/></body></body></body></body>
        </worldbody></mujoco>"""
    ends = []
    for xml in (scene, on_a_tendon(scene, "hinge", "-.014 .014")):
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        data.qvel[:] = 3.0 * np.random.default_rng(38).normal(size=model.nv)
        stepper = Stepper(model, Moreau(0.8), scheme="time-stepping")
        for _ in range(8):
            stepper.step(data)
        ends.append(data.qvel.copy())
    np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-9)
