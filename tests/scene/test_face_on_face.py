"""Boxes whose faces lie on each other have a contact at each corner of the part that these share."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper, read_contacts

PAIR = """<mujoco><worldbody><body><geom type="box" size=".06 .04 .05"/></body>
  <body><freejoint/><geom type="box" size="{} {} .03"/></body></worldbody></mujoco>"""


def _turned(axis, angle):
    quat = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quat, axis / np.linalg.norm(axis), angle)
    return quat


def _corners(contacts):
    return contacts.position[np.lexsort(contacts.position[:, :2].T.round(3))]


@pytest.mark.parametrize("tilt", [1e-13, 1e-10, 1e-6, 1e-4])
def test_tilted_faces_have_the_corners_of_level_ones(tilt):
    """MuJoCo has one contact in a third of these cases; gaps are those of the tilted face above the level one."""
    random = np.random.default_rng(0)
    for _ in range(40):
        model = mujoco.MjModel.from_xml_string(PAIR.format(*random.uniform(0.03, 0.08, 2)))
        data, yaw = mujoco.MjData(model), _turned(np.array([0.0, 0.0, 1.0]), random.uniform(0.1, 1.4))
        data.qpos[:3], data.qpos[3:] = [*random.uniform(-0.05, 0.05, 2), 0.08], yaw
        mujoco.mj_forward(model, data)
        level = read_contacts(model, data, within=1e-4)
        mujoco.mju_mulQuat(data.qpos[3:], _turned(np.append(random.normal(size=2), 0.0), tilt), yaw)
        mujoco.mj_forward(model, data)
        tilted = read_contacts(model, data, within=1e-4)
        np.testing.assert_allclose(_corners(tilted), _corners(level), rtol=0.0, atol=tilt + 1e-9)
        normal = data.geom_xmat[1].reshape(3, 3)[:, 2]
        above = tilted.position[:, :2] - data.qpos[:2]
        gaps = data.qpos[2] - 0.05 - (0.03 + above @ normal[:2]) / normal[2]
        np.testing.assert_allclose(tilted.gap, gaps, rtol=0.0, atol=1e-14 + 0.2 * tilt**2)


@pytest.mark.parametrize(("way", "meter"), [("event-driven", 1), ("time-stepping", 1), ("time-stepping", 100)])
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.filterwarnings("ignore::impactlaw.errors.ManyCollisionsWarning")
def test_piles_of_turned_boxes_come_to_rest(way, meter, e):
    """In meters and in centimeters."""
    random = np.random.default_rng(7)
    for _ in range(2):
        height, bodies = 0.0, ""
        for size in meter * random.uniform(0.04, 0.08, (4, 3)):
            x, y, height = *(meter * random.uniform(-0.01, 0.01, 2)), height + size[2] + meter * 0.004
            bodies += f'<body pos="{x} {y} {height}" euler="0 0 {random.uniform(0, 90)}"><freejoint/>'
            bodies += '<geom type="box" size="{} {} {}" mass="1"/></body>'.format(*size)
            height += size[2]
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option gravity="0 0 {-9.81 * meter}"/><worldbody><geom type="plane" size="1 1 1"/>{bodies}
            </worldbody></mujoco>"""
        )
        data, stepper, collisions = mujoco.MjData(model), Stepper(model, Moreau(e), scheme=way), []
        for _ in range(500):
            stepper.step(data)
            collisions.append(stepper.sums.collisions)
        assert sum(collisions[:200]) > 0
        assert sum(collisions[200:]) == 0
        np.testing.assert_allclose(data.qvel, 0.0, rtol=0.0, atol=1e-9)
