"""What is no step, episode, model or file of a recording is refused, and leaves nothing in it."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.errors import RecordingError, SceneError
from impactlaw.recording import Recorder, read_log


def test_data_of_another_model(tmp_path, scene):
    other = mujoco.MjModel.from_xml_string("<mujoco/>")
    with (
        Recorder(scene[0], tmp_path / "run.rrd") as recorder,
        pytest.raises(RecordingError, match="not of the model"),
    ):
        recorder.step(mujoco.MjData(other))


def test_what_is_no_step_is_refused_and_leaves_nothing(tmp_path, scene):
    model, data = scene
    stepper = Stepper(model, Moreau(0.5))
    wrong = {
        "from its mujoco.MjData, got <impactlaw.stepping.stepper.Stepper": (stepper,),
        "are stepper.events, got <impactlaw": (data, stepper),
        r"are stepper.events, got \[1\]": (data, [1]),
        "are impactlaw.Contacts, got 3": (data, (), 3),
    }
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        for reason, arguments in wrong.items():
            with pytest.raises(RecordingError, match=reason):
                recorder.step(*arguments)
        recorder.step(data)
    assert len(read_log(tmp_path / "run.rrd").series("energy/total")[0]) == 1


@pytest.mark.parametrize(
    "told",
    [
        {"number": "first"},
        {"number": 1.5},
        {"seed": 2**64},
        {"made": 3},
        {"settings": [1, 2]},
        {"generator": {"state": np.zeros(3)}},
    ],
    ids=str,
)
def test_what_is_no_start_of_an_episode_is_refused_and_leaves_nothing(tmp_path, scene, told):
    model, data = scene
    with Recorder(model, tmp_path / "run.rrd") as recorder:
        recorder.step(data)
        with pytest.raises(RecordingError, match=f"{next(iter(told))}.*, got "):
            recorder.begin_episode(**told)
        data.time += 1.0
        recorder.step(data)
    assert len(read_log(tmp_path / "run.rrd").episodes) == 1


def test_changes_and_properties_that_are_no_plain_values_are_refused_and_leave_nothing(tmp_path, scene):
    model, data = scene
    with pytest.raises(RecordingError, match="plain values as restitution"):
        Recorder(model, tmp_path / "run.rrd", restitution=object())
    assert not list(tmp_path.iterdir())
    with Recorder(model, tmp_path / "run.rrd", law="moreau") as recorder:
        recorder.step(data)
        with pytest.raises(RecordingError, match="mapping of plain values as made, got 3"):
            recorder.change_model(3)
        with pytest.raises(RecordingError, match=r"plain values as value .*, got <object"):
            recorder.change_law("newton", object())
        assert recorder.law == "moreau"
        recorder.end_step([0.0], 1.0)
        recorder.step(data)
    (episode,) = read_log(tmp_path / "run.rrd").episodes[:1]
    assert (episode.law_changes, episode.model_changes) == ((), ())


@pytest.mark.parametrize("path", [None, 3, b"run.rrd", ["run.rrd"]], ids=str)
def test_paths_that_are_none(scene, path):
    for use in (read_log, lambda path: Recorder(scene[0], path)):
        with pytest.raises(RecordingError, match="a recording is a file"):
            use(path)


def test_what_is_no_model_is_not_recorded(tmp_path):
    with pytest.raises(SceneError, match=r"a model is a mujoco\.MjModel, got None"):
        Recorder(None, tmp_path / "run.rrd")
    assert not list(tmp_path.iterdir())
