"""A recording shows the scene as MuJoCo does, with energies and poses of their time, and does not change it."""

from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from impactlaw.recording import Recorder, describe, read_log
from impactlaw.recording.geometry import colors, read_geometry
from impactlaw.recording.recorder import BATCH
from impactlaw.recording.rrd import read_entities

KINDS = """
<mujoco model="kinds">
  <option timestep="0.004"/>
  <asset>
    <material name="steel" rgba="0.2 0.4 0.8 1"/>
    <mesh name="tetra" vertex="0 0 0  .6 0 0  0 .6 0  0 0 .6"/>
    <hfield name="hill" nrow="3" ncol="4" size="1 .8 .5 .1"/>
  </asset>
  <worldbody>
    <geom type="plane" size="0 0 1" rgba=".6 .6 .6 1"/>
    <geom type="hfield" hfield="hill" pos="3 0 0" rgba=".3 .6 .3 1"/>
    <geom type="box" size=".05 1 .4" pos="-2.5 0 .4" euler="0 0 20"/>
    <body name="sphere" pos="0 0 .5"><freejoint/><geom type="sphere" size=".3" material="steel"/></body>
    <body name="capsule" pos="-1 0 1"><freejoint/>
      <geom type="capsule" fromto="0 0 0 .5 0 .5" size=".15" rgba="1 0 0 1" material="steel"/>
      <geom type="sphere" size=".1" pos=".5 0 .9" rgba="1 1 0 .5"/>
    </body>
    <body name="ellipsoid" pos="0 1 1"><freejoint/><geom type="ellipsoid" size=".4 .2 .1" euler="0 45 0"/></body>
    <body pos="0 -1 1"><freejoint/><geom type="cylinder" fromto="0 0 0 0 .5 .5" size=".15"/></body>
    <body name="box" pos="1 1 1"><freejoint/><geom type="box" size=".3 .2 .1" euler="30 0 0" pos=".1 0 0"/></body>
    <body name="mesh" pos="1 -1 1"><freejoint/><geom type="mesh" mesh="tetra" pos="0 0 .1" euler="0 0 30"/></body>
    <body name="mocap" mocap="true" pos="-1 -2 .5"><geom type="box" size=".2 .2 .2" contype="0" conaffinity="0"/></body>
    <body name="hidden"><freejoint/><geom type="box" size=".2 .2 .2" group="4"/></body>
    <body name="clear"><freejoint/><geom type="box" size=".2 .2 .2" rgba="1 1 1 0"/></body>
  </worldbody>
</mujoco>
"""
BODIES = ("sphere", "capsule", "ellipsoid", "box", "mesh")


@pytest.fixture
def kinds():
    model = mujoco.MjModel.from_xml_string(KINDS)
    model.hfield_data[:] = np.linspace(0, 1, 12)
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(0).normal(size=model.nv)
    return model, data


def test_energies_and_poses_belong_to_the_positions_of_their_time(tmp_path, kinds):
    model, data = kinds
    check = mujoco.MjData(model)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    times, energies, positions, orientations = [], [], [], []
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for step in range(BATCH + 50):
            data.mocap_pos[0, 0] = 0.01 * step
            mujoco.mj_step(model, data)  # leaves poses and inertia of the previous step in data
            recorder.step(data)
            mujoco.mj_copyState(model, data, check, int(mujoco.mjtState.mjSTATE_INTEGRATION))
            mujoco.mj_forward(model, check)
            times.append(data.time)
            energies.append([check.energy[1], check.energy[0], check.energy.sum()])
            positions.append({name: check.body(name).xpos.copy() for name in (*BODIES, "mocap")})
            orientations.append({name: check.body(name).xquat.copy() for name in BODIES})
    recording = read_log(tmp_path / "run.rrd")
    for i, name in enumerate(("kinetic", "potential", "total")):
        time, energy = recording.series(f"energy/{name}")
        assert time.tolist() == times
        np.testing.assert_allclose(energy, np.array(energies)[:, i], rtol=1e-13)
    for name in (*BODIES, "mocap"):
        time, position = recording.series(f"position/{name}")
        assert time.tolist() == times
        assert position.dtype == float
        np.testing.assert_array_equal(position, np.float32([each[name] for each in positions]))
    for name in BODIES:
        expected = np.float32([each[name] for each in orientations])
        np.testing.assert_array_equal(recording.series(f"orientation/{name}")[1], expected)


def test_recording_changes_nothing(tmp_path, kinds):
    model, data = kinds
    alone = mujoco.MjData(model)
    alone.qvel[:] = data.qvel
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for _ in range(BATCH + 10):
            mujoco.mj_step(model, data)
            mujoco.mj_step(model, alone)
            before = snapshot(data)
            recorder.step(data)
            assert snapshot(data) == before
    integration = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    states = np.zeros((2, mujoco.mj_stateSize(model, integration)))
    for state, each in zip(states, (data, alone), strict=True):
        mujoco.mj_getState(model, each, state, integration)
    assert states[0].tobytes() == states[1].tobytes()


def snapshot(data):
    values = {name: getattr(data, name) for name in dir(data) if not name.startswith("_")}
    arrays = {name: value.tobytes() for name, value in values.items() if isinstance(value, np.ndarray)}
    return arrays | {"time": data.time, "ncon": data.ncon, "contact": data.contact.dist.tobytes()}


def test_geometry_of_every_kind(tmp_path, kinds):
    model, data = kinds
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        recorder.step(data)
    mujoco.mj_kinematics(model, data)
    entities = {n: e for n, e in read_entities(tmp_path / "run.rrd").items() if n.startswith("scene/")}
    drawn = {"/".join(part for part in name.split("/")[1:] if not part.isdigit()) for name in entities}
    assert drawn == {
        "fixed/plane", "fixed/hfield", "fixed/box", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"
    }  # fmt: skip
    bodies = {name for entity in entities.values() for name in entity.static["impactlaw.Geometry:bodies"]}
    assert bodies == {"world", "mocap", "body4", *BODIES}  # neither hidden nor transparent
    assert "position/body4" in read_log(tmp_path / "run.rrd").series_names


def test_geoms_stand_where_mujoco_has_them(kinds):
    model, data = kinds
    mujoco.mj_step(model, data)
    mujoco.mj_kinematics(model, data)
    checked = 0
    for group in read_geometry(model):
        kind = type(group.archetype).__name__
        geoms = [
            geom for geom in np.flatnonzero(np.isin(model.geom_bodyid, group.bodies)) if placed(model, group, geom)
        ]
        for i, geom in enumerate(geoms):
            body = data.body(model.geom_bodyid[geom])
            frame, geom_frame = body.xmat.reshape(3, 3), data.geom_xmat[geom].reshape(3, 3)
            if kind == "Mesh3D":
                corners = numbers(group.archetype.vertex_positions, 3) @ frame.T + body.xpos
                local = (corners - data.geom_xpos[geom]) @ geom_frame
                if "mesh" in group.path:
                    local = local[numbers(group.archetype.triangle_indices, 3).ravel()]
                    np.testing.assert_allclose(local, model.mesh_vert[model.mesh_face.ravel()], atol=1e-6)
                else:
                    np.testing.assert_allclose(local.min(axis=0), [-1, -0.8, 0], atol=1e-6)
                    np.testing.assert_allclose(local.max(axis=0), [1, 0.8, 0.5], atol=1e-6)
            else:
                rotation = np.zeros(9)
                mujoco.mju_quat2Mat(rotation, numbers(group.archetype.quaternions, 4)[i][[3, 0, 1, 2]].astype(float))
                np.testing.assert_allclose(frame @ rotation.reshape(3, 3), geom_frame, atol=1e-6)
                place = group.archetype.translations if kind == "Capsules3D" else group.archetype.centers
                offset = geom_frame.T @ (body.xpos + frame @ numbers(place, 3)[i] - data.geom_xpos[geom])
                below = {"Capsules3D": model.geom_size[geom, 1], "plane": 1e-3 * model.stat.extent}
                expected = below.get(kind, below.get(group.path.split("/")[-1], 0.0))
                np.testing.assert_allclose(offset, [0, 0, -expected], atol=1e-6)
            checked += 1
    assert checked == 11


def test_normals_are_of_length_one_and_those_that_mujoco_shades_with(kinds):
    model, _ = kinds
    normals = {
        "mesh" in group.path: numbers(group.archetype.vertex_normals, 3)
        for group in read_geometry(model)
        if type(group.archetype).__name__ == "Mesh3D"
    }
    slope = np.array([-1 / 11 / 2 * 3 / 2, -4 / 11 / 2 / 0.8, 1.0])  # neighbouring heights differ by 1 / 22 m
    np.testing.assert_allclose(normals[False], np.tile(slope / np.linalg.norm(slope), (36, 1)), atol=1e-6)
    (mesh,), rotation = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[mesh])
    shaded = model.mesh_normal[model.mesh_facenormal.ravel()]
    (drawn,) = (group.archetype for group in read_geometry(model) if "mesh" in group.path)
    of_corners = normals[True][numbers(drawn.triangle_indices, 3).ravel()]
    np.testing.assert_allclose(of_corners, shaded @ rotation.reshape(3, 3).T, atol=1e-6)


BUMP = """
<mujoco>
  <asset><mesh name="bump" builtin="sphere" params="4"/></asset>
  <worldbody>
    <replicate count="5" offset="0 0 3"><body name="bump" pos="0 0 3"><freejoint/>
      <geom type="mesh" mesh="bump"/>
    </body></replicate>
    <body name="red" pos="3 0 0"><freejoint/><geom type="mesh" mesh="bump" rgba="1 0 0 1"/></body>
    <body name="turned" pos="6 0 0"><freejoint/><geom type="mesh" mesh="bump" euler="0 90 0"/></body>
  </worldbody>
</mujoco>
"""


def test_a_vertex_of_a_mesh_is_written_once_for_all_bodies_that_look_the_same(tmp_path):
    model = mujoco.MjModel.from_xml_string(BUMP)
    data = mujoco.MjData(model)
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        recorder.step(data)
    mujoco.mj_kinematics(model, data)
    written = [group.archetype.vertex_positions for group in read_geometry(model)]
    assert [len(vertices) for vertices in written] == [model.nmeshvert] * 3  # five of a kind, a red and a turned one
    recording = read_log(tmp_path / "run.rrd")
    for body in range(1, model.nbody):
        position = recording.series(f"position/{model.body(body).name}")[1]
        np.testing.assert_array_equal(position, np.float32([data.xpos[body]]))


def numbers(batch, width):
    values = batch.as_arrow_array()
    while hasattr(values, "flatten") and values.type.num_fields == 1:
        values = values.flatten()
    return values.to_numpy().reshape(-1, width)


def placed(model, group, geom):
    kind = mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
    drawn = kind in group.path.split("/") and model.geom_bodyid[geom] in group.bodies
    return drawn and model.geom_group[geom] == 0 and model.geom_rgba[geom, 3] > 0


def test_colours_are_those_mujoco_shows(kinds):
    model, _ = kinds
    rgba = {model.body(model.geom_bodyid[geom]).name: colors(model)[geom].tolist() for geom in range(model.ngeom)}
    assert rgba["sphere"] == [51, 102, 204, 255]  # the material's
    assert rgba["box"] == [128, 128, 128, 255]  # the default
    assert colors(model)[4].tolist() == [255, 0, 0, 255]  # its own color takes precedence over the material's


def test_a_scene_without_anything_to_see(tmp_path):
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data = mujoco.MjData(model)
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for _ in range(2):
            mujoco.mj_step(model, data)
            recorder.step(data)
    recording = read_log(tmp_path / "run.rrd")
    assert recording.series("energy/total")[0].tolist() == [model.opt.timestep, data.time]
    assert recording.collisions.empty
    assert recording.worst_violation() is None
    assert recording.contact_summary().empty
    assert "2 states" in describe(recording)


def test_size_on_the_humanoid(tmp_path):
    model = mujoco.MjModel.from_xml_path(str(Path(gymnasium.__file__).parent / "envs/mujoco/assets/humanoid.xml"))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    sizes = []
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for _ in range(3):
            for _ in range(BATCH):
                data.ctrl[:] = rng.uniform(-0.4, 0.4, model.nu)
                mujoco.mj_step(model, data)
                recorder.step(data)
            sizes.append((tmp_path / "run.rrd").stat().st_size)
    assert np.diff(sizes).max() / BATCH < 700 + 8 * (model.nq + model.nv)  # exactly the positions and velocities


def test_a_body_without_a_name_does_not_take_that_of_another_one(tmp_path):
    balls = [f'<body {name} pos="0 0 {z}"><freejoint/><geom size=".1"/></body>' for z, name in enumerate(NAMES, 1)]
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(balls)}</worldbody></mujoco>")
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        recorder.step(mujoco.MjData(model))
    recording = read_log(tmp_path / "run.rrd")
    heights = {name: recording.series(f"position/{name}")[1][0, 2] for name in ("body2", "body2_", "body2__")}
    assert heights == {"body2": 1.0, "body2__": 2.0, "body2_": 3.0}


NAMES = 'name="body2"', "", 'name="body2_"'
