"""Bodies that a collision throws farther than they could move before are stopped by bodies in their way."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_STRUCK = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <geom type="box" size="1 1 .001"/>
  <body pos="0 0 {plate}"><freejoint/><geom type="box" size=".1 .1 .002" mass=".1"/></body>
  <body pos="0 0 .2"><freejoint/><geom size=".05" mass="10"/></body></worldbody></mujoco>"""
"""A heavy ball strikes a plate that rests above a thin floor."""

_FLOOR, _HALF = 0.001, 0.002


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("gap", [5e-4, 2e-3, 2e-2])
@pytest.mark.parametrize("speed", [2.0, 10.0, 40.0])
def test_a_plate_at_rest_is_not_struck_through_a_thin_floor(speed, gap, e):
    model = mujoco.MjModel.from_xml_string(_STRUCK.format(plate=_FLOOR + gap + _HALF))
    data, lowest = mujoco.MjData(model), 1.0
    data.qvel[8] = -speed
    stepper = Stepper(model, Moreau(e), scheme="time-stepping")
    for _ in range(150):
        stepper.step(data)
        lowest = min(lowest, data.qpos[2] - _FLOOR - _HALF)
    assert lowest > -1e-5
    assert data.qpos[9] > data.qpos[2]  # the ball is still above the plate


_THROUGH_A_BALL = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <body mocap="true" pos="{wall} 0 0"><geom type="box" size=".001 1 1"/></body>
  <body pos="0 0 0"><joint type="slide" axis="1 0 0"/><geom size=".01" mass=".001"/></body>
  <body pos="-.1 0 0"><joint type="slide" axis="1 0 0"/><geom size=".01" mass="1"/></body></worldbody></mujoco>"""


def test_so_does_a_body_that_can_be_moved_behind_a_light_ball():
    """The light ball leaves with almost twice the speed of the heavy one."""
    model = mujoco.MjModel.from_xml_string(_THROUGH_A_BALL.format(wall=0.03))
    data = mujoco.MjData(model)
    data.qvel[1] = 20.0
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
    for _ in range(20):
        stepper.step(data)
        assert data.qpos[0] + 0.01 < 0.029 + 1e-5


def column(many):
    """Return the scene of equal balls on a vertical line above a floor, with gaps between them."""
    balls = "".join(
        f'<body pos="0 0 {0.011 + 0.099 * i:.6f}"><joint type="slide" axis="0 0 1"/><geom size=".01" mass="1"/></body>'
        for i in range(many)
    )
    floor = '<geom type="plane" size="9 9 1"/>'
    return f"<mujoco><option integrator='RK4'/><worldbody>{floor}{balls}</worldbody></mujoco>"


@pytest.mark.parametrize(("many", "timestep", "e"), [(5, 5e-4, 0.5), (6, 1e-3, 0.9), (12, 2e-3, 0.7), (12, 4e-3, 0.8)])
def test_a_ball_that_is_thrown_by_one_that_was_thrown_meets_the_next(many, timestep, e):
    """In a falling column a collision passes down from ball to ball within one step; each ball was at rest before."""
    model = mujoco.MjModel.from_xml_string(column(many))
    model.opt.timestep = timestep
    data, deepest = mujoco.MjData(model), 0.0
    stepper = Stepper(model, Moreau(e), scheme="time-stepping")
    for _ in range(round(1.0 / timestep)):
        stepper.step(data)
        height = model.body_pos[1:, 2] + data.qpos
        deepest = min(deepest, height[0] - 0.01, np.diff(height).min() - 0.02)
    assert deepest > -1e-5


_PAIRS = """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody>{}</worldbody>
  <contact><pair geom1="0" geom2="1"/><pair geom1="1" geom2="2"/></contact></mujoco>"""
_BALL = """<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/>
  <geom name="{name}" size="0.1" mass="{mass}" contype="0" conaffinity="0"/></body>"""


def test_geoms_of_a_pair_are_looked_for_as_far_as_both_travel():
    balls = ((-0.201, 1e3), (0.0, 1.0), (0.226, 1.0))  # the second ball is thrown at the third, which comes towards it
    bodies = "".join(_BALL.format(name=i, x=x, mass=mass) for i, (x, mass) in enumerate(balls))
    model = mujoco.MjModel.from_xml_string(_PAIRS.format(bodies))
    data = mujoco.MjData(model)
    data.qvel[:] = 0.49, -1.0, -1.0
    Stepper(model, Moreau(1.0), scheme="time-stepping").step(data)
    assert data.qvel[2] > 1.9
