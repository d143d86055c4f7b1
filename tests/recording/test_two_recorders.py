"""Two recorders of one path do not write to one file: the one that was made last has it."""

import mujoco
import numpy as np
import pytest

from impactlaw.recording import Recorder, read_log

SCENE = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


@pytest.mark.parametrize("linked", [False, True])
def test_the_last_recorder_has_the_file(tmp_path, linked):
    """One that is dropped, as where a cell of a notebook is run again, does not harm it, nor one that goes on."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, path, file = mujoco.MjData(model), tmp_path / "run.rrd", tmp_path / "file.rrd"
    if linked:
        file.touch()
        path.symlink_to(file)
    times = []

    def step(recorder):
        mujoco.mj_step(model, data)
        recorder.step(data)
        times.append(data.time)

    recorder = Recorder(model, path)
    for _ in range(30):
        step(recorder)
    recorder = Recorder(model, path)  # the first one is closed only now
    newer = Recorder(model, path)
    for one in [recorder, recorder, newer] * 20:
        step(one)
    recorder.close()
    newer.close()
    np.testing.assert_array_equal(read_log(path).series("qpos")[0], times[30:][2::3])
    assert path.is_symlink() == linked
    assert sorted(p.name for p in tmp_path.iterdir()) == (["file.rrd", "run.rrd"] if linked else ["run.rrd"])
