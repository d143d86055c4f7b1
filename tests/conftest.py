"""Fixtures of several tests."""

import pytest


@pytest.fixture
def quiet(tmp_path, monkeypatch):
    """MuJoCo writes its warnings into a file where it runs."""
    monkeypatch.chdir(tmp_path)
