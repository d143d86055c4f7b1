"""Options of scripts: wrong ones are refused before anything runs, and Ctrl-C leaves no traceback."""

import signal
import subprocess
import sys
from dataclasses import fields
from typing import get_type_hints

import pytest

from scripts.benchmark.__main__ import Benchmark
from scripts.cone_solvers.__main__ import Study as ConeSolvers
from scripts.controllers.__main__ import Study as Controllers
from scripts.options import read
from scripts.random_collisions.__main__ import RandomCollisions
from scripts.random_scenes.__main__ import RandomScenes
from scripts.robots.__main__ import Study as Robots
from scripts.robots.agreement import Agreement
from scripts.stability.__main__ import Stability
from scripts.transfer.__main__ import Transfer
from scripts.work_precision.__main__ import WorkPrecision

KINDS = (
    *(Benchmark, ConeSolvers, Controllers, RandomCollisions, RandomScenes, Robots, Agreement, Stability, Transfer),
    WorkPrecision,
)
NUMBERS = [(kind, field.name) for kind in KINDS for field in fields(kind) if isinstance(field.default, int | float)]
OPTIONS = [(kind, name) for kind, name in NUMBERS if get_type_hints(kind)[name] is not bool]
SEVERAL = [
    (kind, field.name) for kind in KINDS for field in fields(kind) if field.default and isinstance(field.default, tuple)
]


@pytest.fixture
def refused(monkeypatch, capsys, tmp_path):
    """Return what is told of words of the command line that end the program with exit code 2."""

    def read_words(kind, *words):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["script", *words])
        with pytest.raises(SystemExit) as end:
            read(kind, None)
        assert end.value.code == 2
        return capsys.readouterr().err.replace("\u2502", "")  # the sides of a frame

    return read_words


@pytest.mark.parametrize(("kind", "name"), OPTIONS)
@pytest.mark.parametrize("value", ["-2", "nan", "inf", "", "many"])
def test_numbers_that_make_no_sense(refused, kind, name, value):
    told = refused(kind, f"--{name.replace('_', '-')}", value)
    assert f"--{name.replace('_', '-')}" in told
    assert "must be" in told


def test_a_count_of_none(refused):
    assert "it must be a whole number of 1 or more, got '0'" in " ".join(
        refused(Controllers, "--episodes", "0").split()
    )
    assert "it must be 1 or more, or -1 for one per processor, got '0'" in " ".join(refused(Robots, "-j", "0").split())


@pytest.mark.parametrize(("kind", "name"), SEVERAL)
def test_nothing_to_run(refused, kind, name):
    assert refused(kind, f"--{name}") == f"--{name} is empty: there is nothing to run\n"


def test_a_coefficient_above_one(refused):
    assert "--restitution" in refused(Robots, "--restitution", "0.5", "2")


@pytest.mark.parametrize("folder", ["file", "file/below", "/proc/none"])
def test_a_folder_that_cannot_be_written_into(refused, folder, tmp_path):
    (tmp_path / "file").touch()
    assert refused(Benchmark, "--out", folder).startswith(f"cannot write into {folder}: ")


def test_right_options_make_the_folder(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "argv", ["script", "--steps", "3", "--jobs", "-1", "--out", str(tmp_path / "new")])
    study = read(Robots, None)
    assert (study.steps, study.jobs, study.restitution) == (3, -1, (0.0, 0.5))
    assert list(tmp_path.iterdir()) == [tmp_path / "new"]
    assert not list((tmp_path / "new").iterdir())


def test_ctrl_c_leaves_no_traceback():
    words = [sys.executable, "-c", "import scripts; raise KeyboardInterrupt"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.stderr == "interrupted\n"
    assert ended.returncode == -signal.SIGINT
    words[-1] = "import scripts; raise ValueError('wrong')"
    assert "ValueError: wrong" in subprocess.run(words, capture_output=True, text=True, check=False).stderr
