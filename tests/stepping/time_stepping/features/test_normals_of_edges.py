"""Normals at edges of meshes: MuJoCo gives them that of a face if that is nearly parallel to what hits the edge."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_CUBE = "-1 -1 -1 -1 -1 1 -1 1 -1 -1 1 1 1 -1 -1 1 -1 1 1 1 -1 1 1 1"
_SHAPES = {
    "capsule": 'type="capsule" size=".05 .1"',
    "cylinder": 'type="cylinder" size=".05 .1"',
    "block": 'type="mesh" mesh="bar"',
}
SPEED = 1.0  # m/s


def _hit(shape, tilt):
    """Let a long shape fall across an edge; return its velocity, the normals of contact, and the direction it has.

    The edge is along y, at x = 0, and the shape is nearly along x. It is turned by ``tilt``, rad, about y. The block is
    turned by as much about its long axis, so that one edge crosses another one.
    """
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option gravity="0 0 0" timestep="0.001"/>
      <asset><mesh name="cube" vertex="{_CUBE}" scale=".1 .3 .1"/><mesh name="bar" vertex="{_CUBE}" scale=".02 .05 .1"/>
      </asset><default><geom condim="1" mass="1"/></default><worldbody>
      <geom type="mesh" mesh="cube" pos="-.1 0 -.1"/><body><freejoint/><geom {_SHAPES[shape]}/></body>
      </worldbody></mujoco>""")
    data, turned, gap = mujoco.MjData(model), np.array([0.0, 0.0, tilt if shape == "block" else 0.0]), 0.0107
    along, up = np.array([np.cos(tilt), 0.0, -np.sin(tilt)]), np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    mujoco.mju_mat2Quat(data.qpos[3:], np.column_stack([up, [0.0, -1.0, 0.0], along]).ravel())
    mujoco.mju_quatIntegrate(data.qpos[3:], turned, 1.0)
    data.qpos[:3] = 0.2 * up + 0.02 * along
    mujoco.mj_kinematics(model, data)
    data.qpos[:3] -= (mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None) - gap) * up
    data.qvel[:3] = -SPEED * up
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    while not stepper.events and data.time < 2 * gap / SPEED:
        stepper.step(data)
    return data.qvel, stepper.events[0].contacts.normal, up


@pytest.mark.parametrize("shape", _SHAPES)
@pytest.mark.parametrize("tilt", [0.04, 0.1])
def test_an_edge_pushes_along_the_normal_of_what_lies_across_it(shape, tilt):
    velocity, normal, up = _hit(shape, tilt)
    np.testing.assert_allclose(normal, np.broadcast_to(up, normal.shape), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(np.cross(velocity[:3], up), 0.0, rtol=0.0, atol=1e-6 * SPEED)
