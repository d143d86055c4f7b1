"""`impactlaw study`: its output, and one line for each error."""

import subprocess
import sys

import pytest

import impactlaw.studies
from impactlaw.cli import RunStudy
from impactlaw.errors import ImpactLawError
from impactlaw.studies import Study, quick_study

TASK = "impactlaw/Billiards-v0"


def test_the_quick_study_writes_tables_and_pictures(tmp_path, monkeypatch, capsys):
    whole = quick_study()
    assert len(whole.tasks) == 4
    few = Study(**{**vars(whole), "tasks": whole.tasks[:2], "train": whole.train[:1], "act": whole.act[:2],
                   "seeds": (0,), "episodes": 1})  # fmt: skip
    monkeypatch.setattr(impactlaw.studies, "quick_study", lambda: few)
    monkeypatch.setattr(sys, "path", [*sys.path])
    RunStudy(quick=True, out=tmp_path / "out", jobs=1)()
    printed = capsys.readouterr().out
    assert "impactlaw/Juggler-v0, event-driven: mean return, one seed" in printed
    assert "score under" in printed
    written = {path.name for path in (tmp_path / "out").iterdir() if path.is_file()}
    pictures = {f"impactlaw-{name}-v0-event-driven.png" for name in ("Juggler", "Billiards")}
    assert written == {"table.parquet", "transfer.csv", "transfer.md"} | pictures


def test_a_policy_of_the_folder_where_one_is_acts_in_workers(tmp_path):
    (tmp_path / "mine.py").write_text("def act(observation):\n    return 0.0, 1.0\n")
    arguments = ("study", "--tasks", TASK, "--act", "moreau:0.5", "moreau:0.9", "--policies", "mine:act")
    command = [
        sys.executable,
        "-P",
        "-m",
        "impactlaw.cli",
        *arguments,
        "--seeds",
        "0",
        "--episodes",
        "1",
        "--jobs",
        "2",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert "mine:act" in done.stdout
    assert (tmp_path / "out/study/table.parquet").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "--tasks and --act, or --quick"),
        ({"tasks": (TASK,)}, "--tasks and --act, or --quick"),
        ({"quick": True, "seeds": (0,), "steps": 5}, "leave it out, or --seeds, --steps"),
        ({"quick": True, "address": "tcp://127.0.0.1:1"}, "address means nothing"),
        ({"quick": True, "jobs": 0}, "jobs must be 1 or more, or -1"),
        ({"quick": True, "jobs": -5}, "jobs must be 1 or more, or -1"),
        ({"quick": True, "backend": "nope"}, "unknown backend 'nope'"),
        (
            {
                "tasks": ("Hoper-v5",),
                "act": ("moreau:0.5",),
                "schemes": ("soft",),
                "policies": ("studies.acting:stay",),
            },
            "there is no task 'Hoper-v5'",
        ),
        (
            {"tasks": (TASK,), "act": ("mujoco",), "train": ("newton:0.5",), "policies": ("scripted",)},
            "never under MuJoCo's own",
        ),
        ({"quick": True, "backend": "multiprocessing"}, "does not give results as they are done"),
    ],
)
def test_what_is_missing_or_would_be_ignored_is_refused(options, message, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(ImpactLawError, match=message):
        RunStudy(**options, out=tmp_path / "out")()
    assert not list(tmp_path.iterdir())
