"""Several contact points of one face: a body rolls onto it without pushing itself off the floor."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.compiled import for_python
from impactlaw.stepping.time_stepping.compiled.detection.contact_points import put_on_bodies, put_on_planes

TABLE = """<mujoco><option timestep="0.002" cone="elliptic"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".12 .05 .02" mass="50" contype="0" conaffinity="0"/>
    <geom size=".005" pos="-.1 -.04 -.095"/><geom size=".005" pos=".1 -.04 -.095"/>
    <geom size=".005" pos="-.1 .04 -.095"/><geom size=".005" pos=".1 .04 -.095"/></body></worldbody></mujoco>"""
BODIES, GEOMS = np.array([0, 0, 1], np.int32), np.array([[0, 2], [1, 2]], np.int32)
WELD = np.array([1, 2], np.int32)
BOTH, SECOND = np.array([0, 1], np.int32), np.array([-1, 0], np.int32)  # indices of bodies with degrees of freedom


def test_a_table_that_comes_down_on_four_feet_is_held_without_friction():
    model = mujoco.MjModel.from_xml_string(TABLE)
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.0), scheme="time-stepping")
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
    assert np.ptp(data.geom_xpos[2:, 2]) < 1e-6  # bodies at rest touch below this distance


def _leveled(gaps, heights, second=(0.0, 0.0, 1.0), *, move=BOTH, condim=3):
    """Return whether two points are moved, and their heights afterwards; the second one has the given normal."""
    pos, frame = np.array([[0.0, 0.0, heights[0]], [1.0, 0.0, heights[1]]]), np.zeros((2, 9))
    frame[0, :3], frame[1, :3] = (0.0, 0.0, 1.0), second
    contacts, dim = (np.array(gaps), pos, frame), np.full(2, condim, np.int32)
    moved = for_python(put_on_bodies)(*contacts, dim, GEOMS, BODIES, WELD, move)
    moved = for_python(put_on_planes)(*contacts, GEOMS, BODIES, WELD) or moved
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


def test_points_far_above_what_does_not_move_are_on_the_body():
    assert _leveled([4e-3, 2e-3], [2e-3, 1e-3], move=SECOND) == (True, [4e-3, 2e-3])
    assert _leveled([-4e-3, 2e-3], [-2e-3, 1e-3], move=SECOND) == (True, [-4e-3, 2e-3])
    assert _leveled([4e-3, 2e-3], [2e-3, 1e-3], move=-1 - SECOND) == (True, [0.0, 0.0])
    assert _leveled([4e-3, 2e-3], [2e-3, 1e-3], move=SECOND, condim=1) == (False, [2e-3, 1e-3])


@pytest.mark.parametrize("start", [0.0, 0.3, 0.6, 0.9])  # part of a step at which it hits
@pytest.mark.parametrize("on_a_box", [False, True])
def test_a_ball_that_bounces_and_sticks_gets_the_spin_of_its_radius(start, on_a_box):
    """Jump of a solid sphere that sticks: -2/7 of its speed along the floor, and the spin with which it rolls."""
    h, r, fall, along = 0.005, 0.02, 4.0, 3.0
    ball = f'<body><freejoint/><geom size="{r}" mass="1"/></body>'
    floor = '<geom type="plane" size="1 1 1" friction="3"/>'
    if on_a_box:
        floor = '<geom type="box" size="9 9 .5" pos="0 0 -.5" friction="3"/>'
    option = f'<option timestep="{h}" gravity="0 0 0"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{floor}{ball}</worldbody></mujoco>")
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), scheme="time-stepping")
    data.qpos[2], data.qvel[[0, 2]] = r + fall * h * (2.0 + start), (along, -fall)
    for _ in range(6):
        stepper.step(data)
    np.testing.assert_allclose(data.qvel[[0, 2, 4]], [along * 5 / 7, 0.5 * fall, along * 5 / 7 / r], rtol=1e-9)
