"""What a recording holds is what was simulated, and a file that cannot be written or read says so."""

import ast
import csv
import signal
import subprocess
import sys
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from impactlaw.collision import Collision
from impactlaw.contacts import Contacts
from impactlaw.errors import RecordingError, UnknownNameError
from impactlaw.events import ImpactEvent
from impactlaw.impact import Impact
from impactlaw.laws import Fremond, LinearMap, MaximalDissipation, Moreau, Newton
from impactlaw.models import load
from impactlaw.recording import Recorder, describe, read_log, viewer
from impactlaw.recording.geometry import colors, read_geometry
from impactlaw.recording.layout import COLLISION_COLUMNS, CONTACTS, MARKS
from impactlaw.recording.recorder import BATCH
from impactlaw.recording.rrd import read_entities
from impactlaw.stepper import Stepper

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
KILLED = """
import sys, mujoco
from impactlaw.recording import Recorder
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
recorder = Recorder(model, sys.argv[2])
for step in range(1, 10**9):
    mujoco.mj_step(model, data)
    recorder.step(data)
    if step % 200 == 0:
        print(step, flush=True)
"""


@pytest.fixture
def kinds():
    model = mujoco.MjModel.from_xml_string(KINDS)
    model.hfield_data[:] = np.linspace(0, 1, 12)
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(0).normal(size=model.nv)
    return model, data


@pytest.fixture(scope="module")
def cradle_log(tmp_path_factory):
    model, data = load("newtons_cradle")
    path = tmp_path_factory.mktemp("cradle") / "run.rrd"
    stepper = Stepper(model, Fremond.reversal())
    events = []
    with Recorder(model, path, law=stepper.law, scene="newtons_cradle", seed=3) as recorder:
        for _ in range(450):
            stepper.step(data)
            recorder.step(data, stepper.events)
            events += stepper.events
    return path, events


def random_event(rng, h, nv=8):
    A = rng.normal(size=(nv, nv))
    labels = tuple(f"a/b{i}" for i in range(h))
    collision = Collision(A @ A.T + np.eye(nv), rng.normal(size=(h, nv)), rng.normal(size=nv), labels=labels)
    law = Fremond(rng.uniform(0, 1, size=(h, h))) if h % 2 else Moreau(0.3)
    normal = rng.normal(size=(h, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    contacts = Contacts(labels, np.zeros((h, 2), int), np.zeros(h), rng.normal(size=(h, 3)), normal)
    return contacts, law.resolve(collision)


def record(path, model, data, steps, **options):
    times = []
    with Recorder(model, path, **options) as recorder:
        for _ in range(steps):
            mujoco.mj_step(model, data)
            recorder.step(data)
            times.append(data.time)
    return np.array(times)


def assert_is(row, event):
    impact, violations = event.impact, event.impact.violations
    assert row["time"] == event.time
    assert row["contacts"] == list(event.contacts.labels)
    for name in ("position", "normal"):
        np.testing.assert_array_equal(row[name], getattr(event.contacts, name))
    assert row["pre_contact_velocity"] == impact.collision.pre_contact_velocity.tolist()
    assert row["kinetic_energy"] == impact.collision.kinetic_energy
    for name in ("post_contact_velocity", "impulse", "topology", "antidissipative"):
        assert row[name] == getattr(impact, name).tolist()
    for name in ("intensity", "induced_impulse", "energy_change", "residual"):
        assert row[name] == getattr(impact, name)
    for name in ("kinematic", "kinetic", "energetic"):
        assert row[f"{name}_violation"] == getattr(violations, name)


def test_collisions_come_back_exactly_and_in_order(tmp_path, kinds):
    model, data = kinds
    rng = np.random.default_rng(1)
    events = []
    with Recorder(model, tmp_path / "run.rrd", law=Moreau(0.3)) as recorder:
        for step in range(2 * BATCH + 17):
            now = []
            for _ in range(3 if step in (0, 5, BATCH - 1, BATCH) else int(rng.random() < 0.05)):
                contacts, impact = random_event(rng, int(rng.integers(1, 6)))
                now.append(ImpactEvent(data.time + 0.002, contacts, impact))
            mujoco.mj_step(model, data)
            recorder.step(data, now)
            events += now
    collisions = read_log(tmp_path / "run.rrd").collisions
    assert list(collisions.columns) == list(COLLISION_COLUMNS)
    assert len(collisions) == len(events) > 20
    assert collisions["index"].tolist() == list(range(len(events)))
    assert set(collisions["law"]) == {"Moreau(restitution=0.3)"}
    for (_, row), event in zip(collisions.iterrows(), events, strict=True):
        assert_is(row, event)


def test_collisions_of_a_simulation_come_back(cradle_log):
    path, events = cradle_log
    recording = read_log(path)
    assert len(recording.collisions) == len(events) > 1
    for (_, row), event in zip(recording.collisions.iterrows(), events, strict=True):
        assert_is(row, event)
    time, intensity = recording.series("collision/intensity")
    assert time.tolist() == [event.time for event in events]
    assert intensity.tolist() == [event.impact.intensity for event in events]


def test_extreme_numbers_come_back(tmp_path, kinds):
    model, data = kinds
    collision = Collision(np.eye(1), [[1.0]], [-1e-300], labels=("größe/Boden 1",))
    impact = Impact(collision, np.array([np.nextafter(0.1, 1)]), np.array([np.inf]))
    contacts = Contacts(collision.labels, np.zeros((1, 2), int), np.zeros(1), np.full((1, 3), 1 / 3), np.eye(3)[:1])
    with np.errstate(all="ignore"), Recorder(model, tmp_path / "run.rrd") as recorder:
        recorder.step(data, [ImpactEvent(1e-17, contacts, impact)])
    (row,) = read_log(tmp_path / "run.rrd").collisions.to_dict("records")
    assert row["contacts"] == ["größe/Boden 1"]
    assert row["pre_contact_velocity"] == [-1e-300]
    assert row["post_contact_velocity"] == [np.nextafter(0.1, 1)]
    assert row["impulse"] == [np.inf]
    assert (row["time"], row["law"]) == (1e-17, "")


def test_energies_and_poses_belong_to_the_positions_of_their_time(tmp_path, kinds):
    model, data = kinds
    check = mujoco.MjData(model)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    times, energies, positions, orientations = [], [], [], []
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for step in range(BATCH + 50):
            data.mocap_pos[0, 0] = 0.01 * step
            mujoco.mj_step(model, data)  # leaves poses and inertia of the step before in data
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
    record(tmp_path / "run.rrd", model, data, 1)
    mujoco.mj_kinematics(model, data)
    entities = {n: e for n, e in read_entities(tmp_path / "run.rrd").items() if n.startswith("scene/")}
    drawn = {"/".join(part for part in name.split("/")[1:] if not part.isdigit()) for name in entities}
    assert drawn == {
        "fixed/plane", "fixed/hfield", "fixed/box", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"
    }  # fmt: skip
    bodies = {name for entity in entities.values() for name in entity.static["impactlaw.Geometry:bodies"]}
    assert bodies == {"world", "mocap", "body4", *BODIES}  # neither hidden nor clear
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
    assert colors(model)[4].tolist() == [255, 0, 0, 255]  # its own before the material's


def test_a_scene_without_anything_to_see(tmp_path):
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    times = record(tmp_path / "run.rrd", model, mujoco.MjData(model), 2)
    recording = read_log(tmp_path / "run.rrd")
    assert recording.series("energy/total")[0].tolist() == times.tolist()
    assert recording.collisions.empty
    assert recording.worst_violation() is None
    assert recording.contact_summary().empty
    assert "2 steps" in describe(recording)


def test_contacts_and_marks(tmp_path, cradle_log):
    path, events = cradle_log
    marks = read_entities(path)[MARKS].counts("Points3D:positions").tolist()
    assert marks == [4, 0] * len(events)  # each is taken away again
    one = random_event(np.random.default_rng(0), 1)
    with Recorder(model := load("box_drop")[0], tmp_path / "marks.rrd") as recorder:
        data = mujoco.MjData(model)
        for data.time, events in ((0.0, [0.0]), (0.2, [0.1, 0.13, 0.2]), (0.3, [])):
            recorder.step(data, [ImpactEvent(time, *one) for time in events])
    assert read_entities(tmp_path / "marks.rrd")[MARKS].counts("Arrows3D:vectors").tolist() == [1, 0, 1, 1, 0, 1, 0]
    model, data = load("box_drop")
    data.qpos[2] += 1.0
    four = Contacts(("a/b",) * 4, np.zeros((4, 2), int), np.zeros(4), np.arange(12.0).reshape(4, 3), np.eye(4)[:, :3])
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        recorder.step(data, contacts=four)
        mujoco.mj_step(model, data)
        recorder.step(data)  # in the air
        mujoco.mj_resetDataKeyframe(model, data, 0)
        while data.ncon == 0 or data.contact.dist.max() > 0:
            mujoco.mj_step(model, data)
        recorder.step(data)
    assert read_log(tmp_path / "run.rrd").series("contacts/count")[1].tolist() == [4, 0, data.ncon]
    drawn = read_entities(tmp_path / "run.rrd")[CONTACTS].cells("Points3D:positions")
    assert drawn[0] == four.position.tolist()
    np.testing.assert_array_equal(drawn[2], np.float32(data.contact.pos))


def test_episodes_follow_each_other(tmp_path, kinds):
    model, data = kinds
    rng = np.random.default_rng(0)
    times = []
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for steps in (5, 0, 3):
            mujoco.mj_resetData(model, data)
            for _ in range(steps):
                mujoco.mj_step(model, data)
                times.append(data.time)
                recorder.step(data, [ImpactEvent(data.time, *random_event(rng, 1))])
    recording = read_log(tmp_path / "run.rrd")
    assert recording.series("energy/total")[0].tolist() == times
    assert recording.collisions["time"].tolist() == times
    assert recording.collisions["episode"].tolist() == [0] * 5 + [1] * 3
    assert "in 2 episodes" in describe(recording)


@pytest.mark.parametrize(
    ("law", "restitution", "name", "value"),
    [
        (Moreau(0.1), None, "Moreau(restitution=0.1)", 0.1),
        ("moreau", 0.1, "moreau", 0.1),
        (MaximalDissipation(), None, "MaximalDissipation()", None),
        (Newton((0.1, 1 / 3)), None, "Newton(restitution=(0.1, 0.3333333333333333), default=None)", [0.1, 1 / 3]),
        ("newton", {("a", "b"): np.float64(0.1)}, "newton", {"a, b": 0.1}),
        (Fremond(np.eye(2)), None, "Fremond(matrix=array([[1., 0.], [0., 1.]]))", [[1.0, 0.0], [0.0, 1.0]]),
        (LinearMap([[2.0]]), None, "LinearMap(h=array([[2.]]))", [[2.0]]),
        (None, None, None, None),
    ],
)
def test_properties(tmp_path, kinds, law, restitution, name, value):
    Recorder(kinds[0], tmp_path / "run.rrd", law=law, restitution=restitution, seed=np.int64(7)).close()
    properties = read_log(tmp_path / "run.rrd").properties
    assert properties.pop("versions").keys() == {"impactlaw", "mujoco", "numpy", "rerun"}
    assert properties == {
        "scene": "kinds", "law": name, "restitution": value, "timestep": 0.004, "integrator": "EULER", "seed": 7
    }  # fmt: skip


def test_summaries(cradle_log):
    recording = read_log(cradle_log[0])
    summary = recording.contact_summary()
    assert summary.index.tolist() == [f"ball{i}/ball{i + 1}" for i in range(1, 5)]
    assert (summary["collisions"] == len(recording.collisions)).all()
    total = sum(np.array(row) for row in recording.collisions["impulse"])
    np.testing.assert_allclose(summary["total_impulse"], total, rtol=1e-14)
    assert summary["largest_approach_speed"].max() == -min(
        min(row) for row in recording.collisions["pre_contact_velocity"]
    )
    assert summary["energy"].sum() == pytest.approx(recording.collisions["energy_change"].sum(), abs=1e-12)
    worst = recording.worst_violation()
    assert worst is not None
    assert worst.relative < 1e-12
    assert worst.distance == recording.collisions[f"{worst.kind}_violation"][worst.index]


def test_description(cradle_log):
    recording = read_log(cradle_log[0])
    text = describe(recording)
    for part in ("newtons_cradle", "Reversal(restitution=1.0)", "450 steps", "ball4/ball5", "worst violation", "yes"):
        assert part in text
    assert "... and 1 more" in describe(recording, limit=len(recording.collisions) - 1)


def test_csv_keeps_every_digit(tmp_path, cradle_log):
    path, events = cradle_log
    read_log(path).collisions.to_csv(tmp_path / "run.csv", index=False)
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row, event in zip(rows, events, strict=True):
        assert ast.literal_eval(row["impulse"]) == event.impact.impulse.tolist()
        assert ast.literal_eval(row["contacts"]) == list(event.contacts.labels)
        assert float(row["time"]) == event.time


def test_series_names(cradle_log):
    recording = read_log(cradle_log[0])
    assert {"energy/total", "contacts/count", "position/ball1"} <= set(recording.series_names)
    with pytest.raises(UnknownNameError, match="energy/total"):
        recording.series("energy/totl")


def test_a_killed_run_is_readable(tmp_path):
    scene = Path(gymnasium.__file__).parent / "envs/mujoco/assets/hopper.xml"
    command = [sys.executable, "-c", KILLED, str(scene), str(tmp_path / "run.rrd")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        flushed = 0
        while flushed < 3 * BATCH:
            flushed = int(run.stdout.readline())
        run.send_signal(signal.SIGKILL)
    recording = read_log(tmp_path / "run.rrd")
    time, _ = recording.series("energy/total")
    assert len(time) >= flushed
    model = mujoco.MjModel.from_xml_path(str(scene))
    expected = record(tmp_path / "again.rrd", model, mujoco.MjData(model), len(time))
    np.testing.assert_array_equal(time, expected)
    again = read_log(tmp_path / "again.rrd")
    for name in again.series_names:
        np.testing.assert_array_equal(recording.series(name)[1], again.series(name)[1])


def test_a_file_that_ends_anywhere(tmp_path, cradle_log):
    whole = cradle_log[0].read_bytes()
    reference = read_log(cradle_log[0])
    readable = []
    for end in np.linspace(0, len(whole) - 1, 60).astype(int):
        (tmp_path / "cut.rrd").write_bytes(whole[:end])
        try:
            recording = read_log(tmp_path / "cut.rrd")
        except RecordingError:
            assert not readable, "what is cut off later holds no less"
            continue
        n = len(recording.collisions)
        assert recording.collisions.equals(reference.collisions.head(n))
        steps = 0
        for name in recording.series_names:
            values = recording.series(name)[1]
            steps = len(values) if name == "energy/total" else steps
            np.testing.assert_array_equal(values, reference.series(name)[1][: len(values)])
        readable.append((steps, n))
    assert readable == sorted(readable)
    assert readable[0] == (0, 0)
    assert readable[-1] == (450, len(reference.collisions))


def test_unwritable_path(tmp_path, kinds):
    (tmp_path / "file").touch()
    for path, reason in (
        (tmp_path / "nowhere" / "run.rrd", "No such file"),
        (tmp_path, "directory"),
        (tmp_path / "file" / "run.rrd", "directory"),
    ):
        with pytest.raises(RecordingError, match=reason) as caught:
            Recorder(kinds[0], path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_full_disk(kinds):
    with pytest.raises(RecordingError, match="No space left"):
        Recorder(kinds[0], "/dev/full")


def test_a_recorder_that_cannot_start_leaves_an_old_file_alone(tmp_path, kinds, monkeypatch):
    path = tmp_path / "run.rrd"
    path.write_text("old")
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RecordingError, match="no display"):
        Recorder(kinds[0], path, view=True)
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(RecordingError, match="switched off"):
        Recorder(kinds[0], path)
    assert path.read_text() == "old"
    monkeypatch.delenv("RERUN")
    record(path, *kinds, 1)
    assert len(read_log(path).series("energy/total")[0]) == 1


def test_closed_recorder(tmp_path, kinds):
    model, data = kinds
    recorder = Recorder(model, tmp_path / "run.rrd")
    recorder.close()
    recorder.close()
    recorder.flush()
    with pytest.raises(RecordingError, match="closed"):
        recorder.step(data)
    assert read_log(tmp_path / "run.rrd").collisions.empty


def test_data_of_another_model(tmp_path, kinds):
    other = mujoco.MjModel.from_xml_string("<mujoco/>")
    with (
        Recorder(kinds[0], tmp_path / "run.rrd") as recorder,
        pytest.raises(RecordingError, match="not of the model"),
    ):
        recorder.step(mujoco.MjData(other))


def test_an_exception_in_the_run_keeps_what_was_recorded(tmp_path, kinds):
    model, data = kinds

    def run():
        with Recorder(model, tmp_path / "run.rrd") as recorder:
            recorder.step(data)
            raise KeyError

    with pytest.raises(KeyError):
        run()
    assert len(read_log(tmp_path / "run.rrd").series("energy/total")[0]) == 1


def test_not_a_recording(tmp_path, kinds):
    import rerun as rr

    (tmp_path / "junk.rrd").write_bytes(b"not a recording" * 100)
    (tmp_path / "empty.rrd").touch()
    for application, name in (("somebody", "other"), ("impactlaw", "bare")):
        stream = rr.RecordingStream(application)
        stream.save(tmp_path / f"{name}.rrd")
        stream.log("point", rr.Points3D([0, 0, 0]), strict=True)
        stream.disconnect()
    for name, reason in (
        ("missing", "there is no file"),
        ("", "is not a file"),
        ("junk.rrd", "is not a recording"),
        ("empty.rrd", "is not a recording"),
        ("other.rrd", "not a recording of impactlaw but of somebody"),
        ("bare.rrd", "has no properties"),
    ):
        with pytest.raises(RecordingError, match=reason) as caught:
            read_log(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_a_recording_of_another_format(tmp_path, kinds, monkeypatch):
    monkeypatch.setattr("impactlaw.recording.properties.FORMAT", 2)
    record(tmp_path / "run.rrd", *kinds, 1)
    with pytest.raises(RecordingError, match="has format 2, this version of impactlaw reads format 1"):
        read_log(tmp_path / "run.rrd")


def test_a_viewer_gets_what_the_file_gets_and_may_go(tmp_path, kinds, monkeypatch):
    import rerun as rr

    model, data = kinds
    monkeypatch.setattr(viewer, "spawn_viewer", lambda: rr.FileSink(tmp_path / "seen.rrd"))
    with Recorder(model, tmp_path / "run.rrd", view=True) as recorder:
        recorder.step(data)
        stream = recorder._stream

        def severed():
            raise RuntimeError("gRPC connection severed")

        monkeypatch.setattr(stream, "flush", severed)
        recorder.flush()
        mujoco.mj_step(model, data)
        recorder.step(data)
    for name in ("run", "seen"):
        assert len(read_log(tmp_path / f"{name}.rrd").series("energy/total")[0]) == 2


def test_several_recorders_at_once(tmp_path, kinds):
    model, _ = kinds
    recorders = [Recorder(model, tmp_path / f"{i}.rrd", seed=i) for i in range(3)]
    data = mujoco.MjData(model)
    for step in range(1, 7):
        mujoco.mj_step(model, data)
        recorders[step % 3].step(data)
    for i, recorder in enumerate(recorders):
        recorder.close()
        recording = read_log(tmp_path / f"{i}.rrd")
        assert recording.properties["seed"] == i
        assert len(recording.series("energy/total")[0]) == 2


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
    assert np.diff(sizes).max() / BATCH < 700


def test_importing_is_light():
    heavy = "{'rerun', 'pandas', 'pyarrow', 'gymnasium'}"
    code = f"import impactlaw.recording, sys; assert not {heavy} & sys.modules.keys(), {heavy} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True)
