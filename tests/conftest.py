"""Fixtures of several tests; every run of the tests draws the same random numbers."""

import atexit
import os
import shutil
import sys
import tempfile

import hypothesis
import pytest
import scipy.linalg  # noqa: F401  (loads its BLAS)
import threadpoolctl
from gymnasium.utils import seeding

from impactlaw import Fremond, Stepper
from impactlaw.cli import main
from impactlaw.models import load
from impactlaw.recording import Recorder

hypothesis.settings.register_profile("repeatable", derandomize=True)
hypothesis.settings.load_profile("repeatable")

# Several processes run tests: where there are more threads than cores, they wait for each other.
threadpoolctl.threadpool_limits(1, user_api="blas")
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # of processes that tests start
    os.environ.setdefault(name, "1")

if sys.dont_write_bytecode:  # then each of the hundred processes that tests start would parse all of its imports
    kept = tempfile.mkdtemp(prefix="bytecode-")
    atexit.register(shutil.rmtree, kept, ignore_errors=True)
    os.environ["PYTHONPYCACHEPREFIX"] = kept
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.fixture(autouse=True)
def repeatable(monkeypatch):
    """Seed spaces and environments that are not seeded with 0 instead of the system's entropy."""
    draw = seeding.np_random
    monkeypatch.setattr(seeding, "np_random", lambda seed=None: draw(0 if seed is None else seed))


@pytest.fixture
def quiet(tmp_path, monkeypatch):
    """Run in a temporary folder, where MuJoCo may write its warnings to a file."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run the command line in this process, in an empty folder; return exit code, output and error output."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["impactlaw", *arguments])
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = stop.code
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def scene():
    """A scene to record."""
    return load("box_drop")


@pytest.fixture(scope="session")
def cradle_log(tmp_path_factory):
    """The recording of a run, and the collisions of this run; read-only."""
    model, data = load("newtons_cradle")
    path = tmp_path_factory.mktemp("cradle") / "run.rrd"
    stepper, events = Stepper(model, Fremond.reversal()), []
    with Recorder(model, path, law=stepper.law, scene="newtons_cradle", seed=3) as recorder:
        for _ in range(450):
            stepper.step(data)
            recorder.step(data, stepper.events)
            events += stepper.events
    return path, events
