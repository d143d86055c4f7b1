"""Mocap bodies that are placed elsewhere, and others that move as fast as they can."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_PUT = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="9 9 1"/>
    <body mocap="true" pos="2 0 0.3"><geom type="box" size="0.1 0.1 0.1"/></body>
    <body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize(
    "options",
    [{"scheme": "time-stepping"}, {"scheme": "event-driven"}],
    ids=["time-stepping", "event-driven"],
)
def test_what_is_put_somewhere_else_does_not_strike(options):
    """A box is put beside another one at rest: it comes from 2 m away in one step, and stands there."""
    model = mujoco.MjModel.from_xml_string(_PUT)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), **options)
    for step in range(60):
        if step == 30:
            data.mocap_pos[0] = [0.3, 0.0, 0.3]
        stepper.step(data)
    np.testing.assert_allclose(data.qvel, 0.0, atol=1e-9)
    np.testing.assert_allclose(data.qpos[:3], [0.0, 0.0, 0.1], atol=1e-6)


def test_what_moves_fast_but_not_farther_than_it_is_large_strikes():
    model = mujoco.MjModel.from_xml_string(_PUT)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), scheme="time-stepping")
    data.mocap_pos[0] = [0.45, 0.0, 0.1]
    stepper.step(data)
    for step in range(3):
        data.mocap_pos[0, 0] = 0.45 - 0.1 * (step + 1)
        stepper.step(data)
    assert data.qvel[0] < -50.0
