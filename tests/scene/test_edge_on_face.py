"""Boxes whose edges lie along faces of others touch them at both ends, and come to rest: crates on rails."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper, read_contacts
from impactlaw.scene.pairs import some_side_by_side

RAIL, HALF = 0.007, 0.025  # m: half widths of rails and of crates
RAILS = """<mujoco><option timestep="{step}"/><default><geom friction="0.3"/></default><worldbody>
  <geom type="box" size=".007 .08 .007" pos="-.02 0 0" euler="0 45 0"/>
  <geom type="box" size=".007 .08 .007" pos=".02 0 0" euler="0 {turn} 0"/>
  <body name="crate" pos="0 0 .037" euler="1.2 .6 {yaw}"><freejoint/>
    <geom type="box" size=".025 .025 .025" mass=".07"/></body></worldbody></mujoco>"""
WAYS = {
    "event-driven": {"scheme": "event-driven"},
    "time-stepping": {"scheme": "time-stepping"},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("step", "turn", "yaw", "e"), [(0.01, 45, 2, 0.0), (0.002, 48, 0, 0.0), (0.005, 25, 3, 0.5)])
def test_crates_come_to_rest_on_rails(step, turn, yaw, e, way):
    model = mujoco.MjModel.from_xml_string(RAILS.format(step=step, turn=turn, yaw=yaw))
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(e), **WAYS[way])
    collisions = []
    for _ in range(round(0.8 / step)):
        stepper.step(data)
        collisions.append(stepper.sums.collisions)
    assert sum(collisions[: len(collisions) // 2]) > 0
    assert sum(collisions[len(collisions) // 2 :]) == 0
    np.testing.assert_allclose(data.qvel, 0.0, rtol=0.0, atol=1e-8)
    assert stepper.short_steps == 0


@pytest.mark.parametrize("roll", [1e-5, -1e-4, 1e-3, -0.03, 0.04])
@pytest.mark.parametrize("edge", ["rail", "crate"])
@pytest.mark.parametrize("crate", ["last", "first"])
def test_gaps_at_both_ends_are_those_of_the_edge_above_the_face(roll, edge, crate):
    """The length of the line is that of the crate's face or edge; the gap is measured along the normal of the face."""
    gap, turned = 1e-4, "0.9238795 0 0.3826834 0"  # by 45 degrees about y: an edge points up or down
    rail = '<geom name="rail" type="box" size="{}" quat="{}"/>'
    if edge == "rail":
        rail, quat, top = rail.format(f"{RAIL} .08 {RAIL}", turned), "1 0 0 0", np.sqrt(2.0) * RAIL
        height = top + gap + HALF * np.cos(roll)
    else:
        rail, quat, top = rail.format(".08 .08 .007", "1 0 0 0"), turned, RAIL
        height = top + gap + np.sqrt(2.0) * HALF * np.cos(roll)
    box = f'<geom name="crate" type="box" size="{HALF} {HALF} {HALF}" quat="{quat}"/>'
    box, table = f'<body pos="0 0 {height}"><freejoint/>{box}</body>', f"<body>{rail}</body>"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{table + box if crate == 'last' else box + table}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[3:] = np.cos(roll / 2.0), np.sin(roll / 2.0), 0.0, 0.0
    mujoco.mj_forward(model, data)
    contacts = read_contacts(model, data, within=0.004)
    ends = HALF * np.array([-1.0, 1.0])
    if edge == "rail":  # where the edge, at height top, passes the sides of the crate
        y = (ends - (top - height) * np.sin(roll)) / np.cos(roll)
        expected = y * np.sin(roll) - (top - height) * np.cos(roll) - HALF
    else:
        expected = height + ends * np.sin(roll) - np.sqrt(2.0) * HALF * np.cos(roll) - top
    assert len(contacts) == 2
    # MuJoCo's own contact, the nearer one, has a normal that is tilted by the roll, if edges cross there
    np.testing.assert_allclose(np.sort(contacts.gap), np.sort(expected), rtol=0.0, atol=1e-9 + 0.03 * roll**2)
    np.testing.assert_allclose(np.sort(contacts.position[:, 1]), ends, rtol=0.0, atol=1e-7 + 0.05 * abs(roll))


def test_boxes_that_touch_at_a_point_keep_one_contact():
    """A corner on a face, and edges that cross."""
    for quat, rail in (
        ("0.88 0.28 0.36 0.1", 'size=".007 .08 .007" euler="0 45 0"'),
        ("0.9238795 0 0.3826834 0", 'size=".08 .007 .007" euler="45 0 0"'),
    ):
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody><geom type="box" {rail}/>
            <body pos="0 0 .1"><freejoint/><geom type="box" size=".025 .025 .025" quat="{quat}"/></body>
            </worldbody></mujoco>"""
        )
        data = mujoco.MjData(model)
        for _ in range(30):
            mujoco.mj_kinematics(model, data)
            data.qpos[2] -= mujoco.mj_geomDistance(model, data, 0, 1, 1.0, np.zeros(6)) - 1e-5
        assert len(read_contacts(model, data, within=0.001)) == 1


def test_scenes_with_boxes_on_two_bodies_are_looked_at():
    box, body = '<geom type="box" size="1 1 1"/>', "<body><freejoint/>{}</body>"
    for bodies, some in ((box + body.format(box), True), (body.format(box + box), False)):
        model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
        assert some_side_by_side(model) == some
