"""Fixtures of several tests; every run of the tests draws the same numbers."""

import hypothesis
import pytest
from gymnasium.utils import seeding

hypothesis.settings.register_profile("repeatable", derandomize=True)
hypothesis.settings.load_profile("repeatable")


@pytest.fixture(autouse=True)
def repeatable(monkeypatch):
    """Spaces and environments that nobody seeds draw from seed 0 instead of the system's entropy."""
    draw = seeding.np_random
    monkeypatch.setattr(seeding, "np_random", lambda seed=None: draw(0 if seed is None else seed))


@pytest.fixture
def quiet(tmp_path, monkeypatch):
    """MuJoCo writes its warnings into a file where it runs."""
    monkeypatch.chdir(tmp_path)
