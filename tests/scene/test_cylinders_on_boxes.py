"""Cylinders on boxes and meshes: MuJoCo's contact points would roll them away, and tip those that touch an edge."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper, read_contacts
from impactlaw.scene.tolerances import SKIN

SCENE = """<mujoco><option timestep="0.002" integrator="RK4"/><asset>
  <mesh name="block" vertex="-1 -1 -1 -1 -1 1 -1 1 -1 -1 1 1 1 -1 -1 1 -1 1 1 1 -1 1 1 1" scale=".3 .1 .1"/></asset>
  <worldbody><geom name="table" {table} pos="0 0 .1" friction=".6"/>
  <body pos="0 0 .2501" euler="90 0 {yaw}"><freejoint/><geom name="pipe" type="cylinder" size=".05 .2" mass="2"/></body>
  </worldbody></mujoco>"""
TABLES = {"box": 'type="box" size=".3 .1 .1"', "mesh": 'type="mesh" mesh="block"'}
WAYS = {
    "event-driven": {"scheme": "event-driven"},
    "time-stepping": {"scheme": "time-stepping"},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("yaw", [0, 7])
def test_a_pipe_on_a_table_stays_where_it_is(table, yaw, way):
    model = mujoco.MjModel.from_xml_string(SCENE.format(table=TABLES[table], yaw=yaw))
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.0), **WAYS[way])
    for _ in range(400):
        stepper.step(data)
    assert np.abs(data.qvel).max() < 1e-10
    assert np.abs(data.qpos[:2]).max() < 1e-9


@pytest.mark.parametrize("table", TABLES)
def test_normals_meet_the_axis(table):
    model = mujoco.MjModel.from_xml_string(SCENE.format(table=TABLES[table], yaw=20))
    data = mujoco.MjData(model)
    data.qpos[:3] = [0.013, 0.007, 0.25002]
    contacts = read_contacts(model, data, within=1e-3)
    axis = np.cross([0.0, 0.0, 1.0], data.geom_xmat[1].reshape(3, 3)[:, 2])
    assert len(contacts) == 2
    np.testing.assert_allclose((contacts.position - data.qpos[:3]) @ axis, 0.0, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("seed", range(5))
def test_a_rim_that_hits_a_face_does_not_make_a_smooth_cylinder_spin_about_its_axis(seed, way):
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option gravity="0 0 0" integrator="RK4"/><worldbody>
        <geom type="box" size="1 1 .1" euler="20 30 40" condim="1"/>
        <body><freejoint/><geom type="cylinder" size=".04 .02" condim="1"/></body></worldbody></mujoco>"""
    )
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    mujoco.mj_kinematics(model, data)
    normal = data.geom_xmat[0].reshape(3, 3)[:, 2]
    attitude = rng.normal(size=4)
    data.qpos[:] = *(0.4 * normal), *(attitude / np.linalg.norm(attitude))
    data.qvel[:3] = -3.0 * normal + 0.5 * rng.normal(size=3)
    stepper, collisions = Stepper(model, Moreau(0.8), **WAYS[way]), 0
    for _ in range(60):
        stepper.step(data)
        collisions += len(stepper.events)
    assert collisions > 0
    assert abs(data.qvel[5]) < 1e-6


@pytest.mark.parametrize("kind", ["cylinder", "capsule"])
@pytest.mark.parametrize("seed", range(60))
def test_a_side_touches_an_edge_along_a_line(seed, kind):
    """The smaller gap of both ends is the distance, which MuJoCo measures to 1e-12 m here."""
    rng = np.random.default_rng(seed)
    (r, length), half, turn = rng.uniform(0.02, 0.3, 2), rng.uniform(0.02, 0.3, 3), rng.uniform(0.1, 0.5) * np.pi
    tilt, side = rng.normal(size=2) * 10.0 ** rng.uniform(-6, -3), rng.choice([-1.0, 1.0], 2)
    far = r + 1e-4 + np.hypot(*tilt) * (length + half[2])
    place = side * (half[:2] + far * np.array([np.cos(turn), np.sin(turn)]))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option ccd_tolerance="1e-12" ccd_iterations="200"/><worldbody>
        <geom type="box" size="{half[0]} {half[1]} {half[2]}" margin=".1"/>
        <body pos="{place[0]} {place[1]} {rng.uniform(-0.9, 0.9) * (length + half[2])}"><freejoint/>
        <geom type="{kind}" size="{r} {length}" zaxis="{tilt[0]} {tilt[1]} 1"/></body></worldbody></mujoco>"""
    )
    data, skin = mujoco.MjData(model), 0.0 if kind == "capsule" else SKIN
    mujoco.mj_forward(model, data)
    contacts = read_contacts(model, data, within=0.1)
    assert len(contacts) == 2
    assert contacts.gap.min() == pytest.approx(mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None) - skin, abs=1e-9)
    out = np.array([*(side * np.array([np.cos(turn), np.sin(turn)])), 0.0])
    np.testing.assert_allclose(np.abs(contacts.normal @ out), 1.0, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("kind", "half"), [("cylinder", 0.005), ("cylinder", 0.1), ("capsule", 0.1)])
def test_a_wheel_that_climbs_a_curb_does_not_tip(kind, half, way):
    """With e = 0 it turns about the edge with ``1 - c / 1.5 r`` of its speed, for a curb of height c."""
    r, c, w, h = 0.1, 0.03, 6.0, 0.0005
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{h}" integrator="RK4"/><worldbody><geom type="plane" size="9 9 1"/>
        <geom type="box" size="1 1 {c / 2}" pos="1 0 {c / 2}"/><body pos="-.09 0 {r}" euler="90 0 0"><freejoint/>
        <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 {r * r / 2}"/><geom type="{kind}" size="{r} {half}"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[0], data.qvel[5] = r * w, -w
    stepper, collisions = Stepper(model, Moreau(0.0), **WAYS[way]), 0
    for _ in range(80):
        stepper.step(data)
        collisions += len(stepper.events)
    np.testing.assert_allclose(data.qvel[[1, 3, 4]], 0.0, atol=1e-9)
    rest = 0.75 * (r * w * (1.0 - c / (1.5 * r))) ** 2 - 9.81 * (data.qpos[2] - r)
    assert -data.qvel[5] == pytest.approx(np.sqrt(rest / 0.75) / r, rel=1e-4 if way == "event-driven" else 0.01)
    assert collisions == 1 or way != "event-driven"


@pytest.mark.parametrize("seed", range(40))
def test_a_flat_end_touches_an_edge_along_a_chord(seed):
    rng = np.random.default_rng(seed)
    (r, length), half, turn = rng.uniform(0.02, 0.3, 2), rng.uniform(0.02, 0.3, 3), rng.uniform(0.05, 0.45) * np.pi
    tilt, side = rng.normal() * 10.0 ** rng.uniform(-6, -3), rng.choice([-1.0, 1.0], 2)
    out = np.array([*(side * np.array([np.cos(turn), np.sin(turn)])), tilt]) / np.hypot(1.0, tilt)
    across = np.array([-out[1], out[0], 0.0]) / np.hypot(*out[:2])
    edge = np.array([*(side * half[:2]), rng.uniform(-0.9, 0.9) * half[2]])
    place, axis = edge + (length + 0.01) * out + rng.uniform(-0.9, 0.9) * r * across, rng.choice([-1.0, 1.0]) * out
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option ccd_tolerance="1e-12" ccd_iterations="200"/><worldbody>
        <geom type="box" size="{half[0]} {half[1]} {half[2]}" margin=".1"/>
        <body pos="{place[0]} {place[1]} {place[2]}"><freejoint/>
        <geom type="cylinder" size="{r} {length}" zaxis="{axis[0]} {axis[1]} {axis[2]}"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    contacts = read_contacts(model, data, within=0.1)
    assert len(contacts) == 2
    assert contacts.gap.min() == pytest.approx(mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None) - SKIN, rel=1e-4)
    np.testing.assert_allclose(np.abs(contacts.normal @ out), 1.0, rtol=0.0, atol=1e-9)
    apart = np.diff(contacts.position, axis=0)[0]
    assert np.linalg.norm(np.cross(apart, [0.0, 0.0, 1.0])) < 0.01 * np.linalg.norm(apart)


@pytest.mark.parametrize("way", WAYS)
def test_a_puck_tips_over_the_edge_of_a_table_like_a_plate(way):
    """It turns about the edge until it slides: its contacts stay closed, and it does not turn aside."""
    r, half, over = 0.1, 0.02, 0.03
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.001" integrator="RK4"/><worldbody>
        <geom type="box" size="1 1 .5" pos="-1 0 -.5"/><body pos="{over} 0 {half}"><freejoint/>
        <geom type="cylinder" size="{r} {half}" mass="1" friction="2"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    stepper, collisions = Stepper(model, Moreau(0.0), **WAYS[way]), 0
    for _ in range(80):
        stepper.step(data)
        collisions += len(stepper.events)
    turned = 2.0 * np.arctan2(data.qpos[5], data.qpos[3])
    fallen = half - (half * np.cos(turned) - over * np.sin(turned))
    inertia = r**2 / 4 + half**2 / 3 + half**2 + over**2
    assert turned > 0.2
    assert data.qvel[4] == pytest.approx(np.sqrt(2 * 9.81 * fallen / inertia), rel=1e-3)
    np.testing.assert_allclose(data.qvel[[1, 3, 5]], 0.0, atol=1e-9)
    assert collisions <= 1
    assert stepper.short_steps == stepper.unlocated == 0
