"""Cylinders that lie on boxes and meshes: MuJoCo's contact points beside the axis would roll them away."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper, read_contacts

SCENE = """<mujoco><option timestep="0.002" integrator="RK4"/><asset>
  <mesh name="block" vertex="-1 -1 -1 -1 -1 1 -1 1 -1 -1 1 1 1 -1 -1 1 -1 1 1 1 -1 1 1 1" scale=".3 .1 .1"/></asset>
  <worldbody><geom name="table" {table} pos="0 0 .1" friction=".6"/>
  <body pos="0 0 .2501" euler="90 0 {yaw}"><freejoint/><geom name="pipe" type="cylinder" size=".05 .2" mass="2"/></body>
  </worldbody></mujoco>"""
TABLES = {"box": 'type="box" size=".3 .1 .1"', "mesh": 'type="mesh" mesh="block"'}
WAYS = {
    "event-driven": {"scheme": "event-driven"},
    "compiled": {"scheme": "time-stepping"},
    "python": {"scheme": "time-stepping", "compiled": "never"},
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
