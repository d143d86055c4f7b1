"""A stepper can be pickled before its collisions are read."""

import pickle

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_BALL = '<body pos="0 0 {}"><joint type="slide" axis="0 0 1"/><geom size=".1" condim="1"/></body>'
_SCENE = f"""<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="1 1 1" condim="1"/>
  {_BALL.format(0.1)}{_BALL.format(0.305)}</worldbody></mujoco>"""


@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_collisions_of_a_pickled_stepper(speed):
    """The lower ball hits the floor and, if it is fast, the upper one after it in the same step."""
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    data.qvel[0] = -speed
    stepper = Stepper(model, Moreau(0.8), scheme="time-stepping", compiled="never")
    stepper.step(data)
    copied = pickle.loads(pickle.dumps(stepper))
    assert len(copied.events) == (2 if speed > 1.0 else 1)
    for own, other in zip(stepper.events, copied.events, strict=True):
        np.testing.assert_array_equal(own.impact.post_velocity, other.impact.post_velocity)
