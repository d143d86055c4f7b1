"""Truncated recordings are readable; files that cannot be written or read are reported in one line."""

import signal
import subprocess
import sys
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from impactlaw.errors import RecordingError
from impactlaw.recording import Recorder, read_log, viewer
from impactlaw.recording.recorder import BATCH

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


def record(path, model, data, steps, **options):
    times = []
    with Recorder(model, path, **options) as recorder:
        for _ in range(steps):
            mujoco.mj_step(model, data)
            recorder.step(data)
            times.append(data.time)
    return np.array(times)


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


def test_unwritable_path(tmp_path, scene):
    (tmp_path / "file").touch()
    for path, reason in (
        (tmp_path / "nowhere" / "run.rrd", "No such file"),
        (tmp_path, "directory"),
        (tmp_path / "file" / "run.rrd", "directory"),
    ):
        with pytest.raises(RecordingError, match=reason) as caught:
            Recorder(scene[0], path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_full_disk(scene):
    with pytest.raises(RecordingError, match="No space left"):
        Recorder(scene[0], "/dev/full")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads as Linux tells them")
def test_closed_recordings_leave_no_threads(tmp_path, scene):
    record(tmp_path / "first.rrd", *scene, 1)
    before = len(list(Path("/proc/self/task").iterdir()))
    for number in range(8):
        record(tmp_path / f"{number}.rrd", *scene, 1)
    assert len(list(Path("/proc/self/task").iterdir())) <= before


def test_a_recording_has_a_layout(tmp_path, scene):
    record(tmp_path / "run.rrd", *scene, 1)
    file = RrdReader(tmp_path / "run.rrd")
    (layout,) = file.blueprints()
    paths = {chunk.entity_path.split("/")[1] for chunk in file.stream(store=layout).to_chunks()}
    assert {"viewport", "container", "view"} <= paths


LIMITED = """
import resource, sys, mujoco
from impactlaw.models import load
from impactlaw.recording import Recorder
from impactlaw.recording.output import file
file._PATIENCE = 2.0
model, data = load("newtons_cradle")
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
with Recorder(model, sys.argv[1]) as recorder:
    for _ in range(3000):
        mujoco.mj_step(model, data)
        recorder.step(data)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no limit of the size of files")
@pytest.mark.parametrize("limit", [500, 20_480, 100_000, 204_800])
def test_a_disk_that_is_full_ends_the_run(tmp_path, limit):
    """Rerun waits forever once its writer is gone: at the start, in a flush, and at the end of the process."""
    runs = []
    for number in range(3):  # the outcome depends on which of its threads is the first
        command = [sys.executable, "-c", LIMITED, str(tmp_path / f"{number}.rrd"), str(limit)]
        runs.append(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
    for run in runs:  # all wait for Rerun at the same time
        told = run.communicate(timeout=600)[1]
        assert run.returncode == 1
        assert "RecordingError: cannot write the recording" in told


def test_a_recorder_that_cannot_start_leaves_an_old_file_alone(tmp_path, scene, monkeypatch):
    path = tmp_path / "run.rrd"
    path.write_text("old")
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RecordingError, match="no display"):
        Recorder(scene[0], path, view=True)
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(RecordingError, match="switched off"):
        Recorder(scene[0], path)
    assert path.read_text() == "old"
    monkeypatch.delenv("RERUN")
    record(path, *scene, 1)
    assert len(read_log(path).series("energy/total")[0]) == 1


def test_closed_recorder(tmp_path, scene):
    model, data = scene
    recorder = Recorder(model, tmp_path / "run.rrd")
    recorder.close()
    recorder.close()
    recorder.flush()
    with pytest.raises(RecordingError, match="closed"):
        recorder.step(data)
    with pytest.raises(RecordingError, match="closed"):
        recorder.end_step([0.0], 1.0)
    assert read_log(tmp_path / "run.rrd").collisions.empty


def test_an_exception_in_the_run_keeps_what_was_recorded(tmp_path, scene):
    model, data = scene

    def run():
        with Recorder(model, tmp_path / "run.rrd") as recorder:
            recorder.step(data)
            raise KeyError

    with pytest.raises(KeyError):
        run()
    assert len(read_log(tmp_path / "run.rrd").series("energy/total")[0]) == 1


def test_not_a_recording(tmp_path, scene):
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


def test_a_recording_that_may_not_be_read(tmp_path, scene, monkeypatch):
    record(tmp_path / "run.rrd", *scene, 1)
    monkeypatch.setattr("os.access", lambda path, mode: False)  # permissions do not hold for root
    with pytest.raises(RecordingError, match="no permission to read"):
        read_log(tmp_path / "run.rrd")


def test_a_recording_of_another_format(tmp_path, scene, monkeypatch):
    monkeypatch.setattr("impactlaw.recording.properties.FORMAT", 2)
    record(tmp_path / "run.rrd", *scene, 1)
    with pytest.raises(RecordingError, match="has format 2, this version of impactlaw reads format 1"):
        read_log(tmp_path / "run.rrd")


def test_a_viewer_gets_what_the_file_gets_and_may_go(tmp_path, scene, monkeypatch):
    import rerun as rr

    model, data = scene
    monkeypatch.setattr(viewer, "spawn_viewer", lambda: rr.FileSink(tmp_path / "seen.rrd"))
    with Recorder(model, tmp_path / "run.rrd", view=True) as recorder:
        recorder.step(data)

        def severed(stream, timeout_sec):
            raise RuntimeError("gRPC connection severed")

        monkeypatch.setattr(rr.RecordingStream, "flush", severed)
        recorder.flush()
        mujoco.mj_step(model, data)
        recorder.step(data)
    for name in ("run", "seen"):
        assert len(read_log(tmp_path / f"{name}.rrd").series("energy/total")[0]) == 2


def test_several_recorders_at_once(tmp_path, scene):
    model, _ = scene
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


def test_importing_is_light():
    heavy = "{'rerun', 'pandas', 'pyarrow', 'gymnasium'}"
    code = f"import impactlaw.recording, sys; assert not {heavy} & sys.modules.keys(), {heavy} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True)


LEFT_OPEN = """
import sys, gymnasium, impactlaw.envs
env = gymnasium.make("impactlaw/Juggler-v0", log=sys.argv[1])
env.reset(seed=0)
for _ in range(200):
    env.step([0.1])
"""


def test_a_run_that_nobody_closes_is_whole(tmp_path):
    """The last environment step ends with a frame that is only flushed with the next ones."""
    command = [sys.executable, "-c", LEFT_OPEN, str(tmp_path / "run.rrd")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    assert "Traceback" not in done.stderr
    (episode,) = read_log(tmp_path / "run.rrd").episodes
    assert len(episode.actions) == 200
    assert len(episode.time) == 1001


def test_a_recorder_that_is_gone_has_written_its_file(tmp_path, scene):
    model, data = scene
    Recorder(model, tmp_path / "run.rrd").step(data)
    assert len(read_log(tmp_path / "run.rrd").episode(0).time) == 1
