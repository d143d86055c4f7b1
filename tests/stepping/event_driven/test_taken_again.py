"""A step that raises is undone, with the motion of its mocap bodies."""

import mujoco
import pytest

from impactlaw import Fremond, Moreau, Stepper
from impactlaw.errors import InadmissibleImpactError

_SCENE = """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody>
  <body mocap="true"><geom type="box" size=".2 .2 .05"/></body>
  <body pos="0 0 .1625"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""


def test_a_paddle_throws_the_ball_in_the_step_that_is_taken_again():
    model = mujoco.MjModel.from_xml_string(_SCENE)
    stepper, data = Stepper(model, Fremond([[2.0]]), friction="ignore"), mujoco.MjData(model)
    raised = 0
    for _ in range(6):
        data.mocap_pos[0, 2] += 0.005
        try:
            stepper.step(data)
        except InadmissibleImpactError:
            raised += 1
            stepper.law = Moreau(1.0)
            stepper.step(data)
    assert raised == 1
    assert data.qvel[2] == pytest.approx(1.0)
