"""Single runs of a comparison: their starts and their ends."""

import sys

import pytest

from impactlaw.cli import main
from impactlaw.comparison.compare import Comparison, compare, format_table
from impactlaw.recording import read_log


def test_recordings_begin_with_the_start(tmp_path):
    """The wedge loses all of its energy in the first step, so that only the start shows it."""
    compare(Comparison(scene="wedge", laws=("maximal-dissipation",), duration=0.1), tmp_path)
    for run in ("maximal-dissipation", "mujoco", "mujoco-tuned"):
        time, energy = read_log(tmp_path / f"{run}.rrd").series("energy/total")
        assert (len(time), time[0]) == (11, 0.0)
        assert energy[0] == pytest.approx(0.78125, abs=1e-12)


def test_a_law_that_does_not_fit_a_collision_is_refused_and_the_others_run(tmp_path):
    table = compare(Comparison(scene="ball_chain", laws=("moreau", "routh"), duration=0.05), tmp_path).set_index("run")
    assert "one contact at a time" in table.loc["routh", "refused"]
    assert "routh was refused: " in format_table(table.reset_index())  # the refused run has no collision to report
    assert table["refused"].drop("routh").tolist() == ["", "", ""]
    assert {f"{run}.rrd" for run in table.index} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize("words", [("--restitution", "1.5"), ("--laws", "moreau", "fremond")])
def test_what_is_wrong_with_all_runs_is_refused_before_the_first_one(words, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["impactlaw", "compare", "ball_chain", *words, "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


SPRING = """<mujoco><option timestep=".01"/><worldbody>
  <geom name="floor" type="plane" size="1 1 1" condim="1"/>
  <body pos="0 0 .5"><joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" condim="1"/></body>
  <body pos="1 0 2"><joint name="spring" type="slide" axis="0 0 1" stiffness="{stiffness}"/>
    <geom size=".1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("stiffness", ["1e7", "1e300"])
def test_a_run_of_mujoco_that_diverges_ends_there(stiffness, tmp_path):
    """MuJoCo resets to the initial state at time 0; with the larger stiffness this happens after the first steps."""
    scene = tmp_path / "spring.xml"
    scene.write_text(SPRING.format(stiffness=stiffness))
    table = compare(Comparison(scene=str(scene), laws=("moreau",), duration=0.5), tmp_path).set_index("run")
    for run in ("mujoco", "mujoco-tuned"):
        assert "left the finite numbers" in table.loc[run, "refused"]
        recording = read_log(tmp_path / f"{run}.rrd")
        assert len(recording.episodes) == 1
        assert recording.series("qpos")[0][-1] < 0.5
