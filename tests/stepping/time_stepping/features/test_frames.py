"""Contact frames that MuJoCo does not make orthogonal: friction is independent of the orientation of the scene."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from impactlaw import Moreau, Stepper

CAPSULE = """<mujoco><option timestep="0.002" gravity="{gravity}"/><worldbody>
  <geom type="plane" size="1 1 1" quat="{quat}" friction=".1"/>
  <body pos="{pos}" quat="{quat}"><freejoint/><geom type="capsule" size=".05 .1" friction=".1" mass="1"/></body>
  </worldbody></mujoco>"""
TURNED = [Rotation.from_euler("y", 90, degrees=True), *(Rotation.random(random_state=k) for k in range(8))]


def _landed(turned: Rotation, e: float) -> np.ndarray:
    """Return the velocity after an upright capsule slides over a plane, both rotated, in the frame of the plane."""
    up = turned.apply([0.0, 0.0, 1.0])
    numbers = {"gravity": -9.81 * up, "pos": 0.16 * up, "quat": np.roll(turned.as_quat(), 1)}
    xml = CAPSULE.format(**{name: " ".join(map(repr, values.tolist())) for name, values in numbers.items()})
    model = mujoco.MjModel.from_xml_string(xml)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(e), scheme="time-stepping")
    data.qvel[:3] = turned.apply([2.0, 1.0, -1.0])
    while not stepper.events:
        stepper.step(data)
    return np.concatenate([turned.inv().apply(data.qvel[:3]), data.qvel[3:]])


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_an_upright_capsule_lands_as_on_a_level_plane(e):
    level = _landed(Rotation.identity(), e)
    assert level[2] >= -1e-9
    for turned in TURNED:
        np.testing.assert_allclose(_landed(turned, e), level, rtol=0, atol=1e-9)
