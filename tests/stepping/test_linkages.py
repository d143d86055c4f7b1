"""Planar linkages, closed by welds or connects, with hinges that are parallel up to the digits of the file."""

import mujoco
import numpy as np
import pytest
from scenes import WAYS

from impactlaw import Moreau, Stepper

LINKAGE = """<mujoco><compiler angle="radian"/><option timestep="0.001" gravity="{gravity}"/><worldbody>
  <frame euler="{turned}">
    <geom type="plane" size="1 1 1"/>
    <body name="a" pos="0 0 .2"><joint axis="0 1 0"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/></body>
    <body name="b" pos="0 0 .2" quat="{quat}"><joint axis="0 1 0"/>
      <geom type="box" size=".02 .1 .03" mass=".3" contype="0" conaffinity="0"/></body>
    <body pos=".15 0 1" gravcomp="1"><joint type="slide" axis="0 0 1"/><geom size=".02" mass=".2"/></body>
  </frame></worldbody><equality>{tie}</equality></mujoco>"""
TIES = {"weld": '<weld body1="a" body2="b"/>', "connect": '<connect body1="a" body2="b" anchor=".1 .01 .1"/>'}
AS_WRITTEN = "1 1e-6 0 2e-6"  # the axes of the hinges differ by some 4e-6 rad


def run(way, tie, quat, *, gravity="0 0 0", turned="0 0 0", thrown=0.0, steps=300):
    """Return positions and velocities, and the deepest contact, m."""
    model = mujoco.MjModel.from_xml_string(LINKAGE.format(gravity=gravity, turned=turned, quat=quat, tie=TIES[tie]))
    data, deepest = mujoco.MjData(model), 0.0
    stepper = Stepper(model, Moreau(0.5), **WAYS[way])
    data.qvel[2] = thrown
    for _ in range(steps):
        stepper.step(data)
        deepest = min([deepest, *data.contact.dist])
    return data.qpos, data.qvel, deepest


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("tie", TIES)
@pytest.mark.parametrize("quat", [AS_WRITTEN, "1 .001 0 .002"])
def test_the_floor_holds_a_crank_of_two_welded_parts(way, tie, quat):
    (angle, *_), _, deepest = run(way, tie, quat, gravity="0 0 -9.81", steps=600)
    assert deepest > -2e-3
    assert angle == pytest.approx(0.6027, abs=2e-3)  # sin(angle) = (0.2 - 0.03) / 0.3


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("tie", TIES)
@pytest.mark.parametrize("turned", ["0 0 0", ".3 .4 .5"])
def test_a_ball_turns_a_crank_as_if_its_hinges_were_parallel(way, tie, turned):
    thrown = {"turned": turned, "thrown": -10.0, "steps": 100}
    _, expected, _ = run(way, tie, "1 0 0 0", **thrown)
    _, velocity, _ = run(way, tie, AS_WRITTEN, **thrown)
    assert velocity[0] > 5.0
    np.testing.assert_allclose(velocity, expected, atol=5e-3)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("tie", TIES)
def test_the_collision_that_is_told_turns_the_crank_as_the_step_does(way, tie):
    model = mujoco.MjModel.from_xml_string(
        LINKAGE.format(gravity="0 0 0", turned=".3 .4 .5", quat=AS_WRITTEN, tie=TIES[tie])
    )
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), **WAYS[way])
    data.qvel[2] = -10.0
    while not stepper.events:
        stepper.step(data)
    impact = stepper.events[0].impact
    assert impact.post_velocity[0] > 5.0
    np.testing.assert_allclose(impact.post_velocity, data.qvel, atol=5e-3 * np.abs(data.qvel).max())
    assert stepper.sums.energy_change == pytest.approx(impact.energy_change, rel=1e-2)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("crank", [0.17, 0.1])
def test_a_piston_bounces_off_a_stop_next_to_its_dead_centre(way, crank):
    """Regression: the stop had no effect where the piston moves by less than 0.04 m per rad of the crank.

    The mechanism can move in one way only, so that every velocity is multiplied by -e.
    """
    e, r, length = 0.6, 0.1, 0.25
    far = r * np.cos(crank) + np.sqrt(length**2 - (r * np.sin(crank)) ** 2)  # where the piston is stopped, m
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="2.5e-4" integrator="RK4" gravity="0 0 0"/>
      <default><geom contype="0" conaffinity="0"/></default><worldbody>
      <geom type="plane" size="1 1 1" zaxis="-1 0 0" pos="{far + 0.02} 0 0" contype="1"/>
      <body><joint axis="0 -1 0"/><geom size=".05" mass="8"/>
        <body name="rod" pos="{r} 0 0"><joint axis="0 -1 0"/>
          <geom type="capsule" size=".01" fromto="0 0 0 {length} 0 0" mass=".3"/></body></body>
      <body name="piston" pos="{r + length} 0 0"><joint type="slide" axis="1 0 0"/>
        <geom size=".02" mass=".5" conaffinity="1" condim="1"/></body>
      </worldbody><equality>
      <connect body1="piston" body2="rod" anchor="0 0 0" solref="1e-3 1" solimp=".9999 .9999 .001"/>
      </equality></mujoco>""")
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(e), **WAYS[way])
    tilt = np.arcsin(r * np.sin(1.0) / length)
    data.qpos[:] = 1.0, -1.0 - tilt, r * np.cos(1.0) + length * np.cos(tilt) - r - length
    rate = r * np.cos(1.0) / (length * np.cos(tilt))  # of the rod, per rad of the crank
    data.qvel[:] = -6.0, 6.0 * (1.0 + rate), 6.0 * r * (np.sin(1.0) + np.cos(1.0) * np.tan(tilt))
    for _ in range(1000):
        before = data.qvel.copy()
        stepper.step(data)
        if stepper.events:
            break
    np.testing.assert_allclose(data.qvel, -e * before, atol=0.03 * np.abs(before).max())
    assert stepper.sums.energy_change < 0.0
