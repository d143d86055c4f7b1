"""Several points of contact of one face: a body rolls onto it without bracing itself against the floor."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.stepping.time_stepping.problem.planes import mend_contacts

TABLE = """<mujoco><option timestep="0.002" cone="elliptic"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".12 .05 .02" mass="50" contype="0" conaffinity="0"/>
    <geom size=".005" pos="-.1 -.04 -.095"/><geom size=".005" pos=".1 -.04 -.095"/>
    <geom size=".005" pos="-.1 .04 -.095"/><geom size=".005" pos=".1 .04 -.095"/></body></worldbody></mujoco>"""
BODIES, GEOMS = np.array([0, 0, 1], np.int32), np.array([[0, 2], [1, 2]], np.int32)


@pytest.mark.parametrize("compiled", ["auto", "never"])
def test_a_table_that_comes_down_on_four_feet_is_held_without_friction(compiled):
    model = mujoco.MjModel.from_xml_string(TABLE)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.0), scheme="time-stepping", compiled=compiled)
    data.qpos[3:7] = 1.0, 0.5e-5, 1e-5, 0.0  # feet are up to 3e-6 m above the floor
    mujoco.mj_kinematics(model, data)
    data.qpos[2] -= data.geom_xpos[2:, 2].min() - 0.005
    for _ in range(4):
        stepper.step(data)
        forces = np.zeros((data.ncon, 6))
        for k in range(data.ncon):
            mujoco.mj_contactForce(model, data, k, forces[k])
        assert np.abs(forces[:, 1:3]).max() < 0.1 * forces[:, 0].max()
    assert np.abs(data.qvel).max() < 1e-9
    assert np.ptp(data.geom_xpos[2:, 2]) < 1e-6  # bodies at rest touch from there


def _leveled(gaps, heights, second=(0.0, 0.0, 1.0)):
    """Return whether two points move, and their heights after; the second has this normal."""
    pos, frame = np.array([[0.0, 0.0, heights[0]], [1.0, 0.0, heights[1]]]), np.zeros((2, 9))
    frame[0, :3], frame[1, :3] = (0.0, 0.0, 1.0), second
    moved = mend_contacts(np.array(gaps), pos, frame, GEOMS, BODIES)
    return moved, pos[:, 2].tolist()


def test_points_of_one_face_lie_in_the_plane_of_the_one_with_the_least_gap():
    assert _leveled([0.0, 4e-6], [0.0, 2e-6]) == (True, [0.0, 0.0])
    assert _leveled([-4e-6, 1e-9], [-2e-6, 0.0]) == (True, [0.0, 0.0])
    assert _leveled([1e-9, 1e-9], [0.0, 0.0]) == (False, [0.0, 0.0])


@pytest.mark.parametrize(
    ("gaps", "heights", "normal"),
    [
        ([0.0, 4e-6], [0.0, 0.1], (0.0, 0.0, 1.0)),
        ([0.0, 4e-6], [0.0, 2e-6], (1e-3, 0.0, 1.0)),
        ([0.0, 4e-3], [0.0, 2e-3], (0.0, 0.0, 1.0)),
    ],
    ids=["two steps of a stair", "two slopes", "a corner far above the floor"],
)
def test_points_stay_where_they_are_not_of_one_face(gaps, heights, normal):
    assert _leveled(gaps, heights, normal) == (False, heights)
