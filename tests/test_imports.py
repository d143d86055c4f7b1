"""What ``import impactlaw`` loads: nothing that a simulation may never use."""

import subprocess
import sys

import pytest

LATER = [
    "rerun",
    "gymnasium",
    "dm_control",
    "osqp",
    "matplotlib",
    "pandas",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.spatial",
]


@pytest.fixture(scope="module")
def loaded() -> set[str]:
    code = "import sys, impactlaw; print(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.parametrize("module", LATER)
def test_not_imported_before_it_is_used(loaded, module):
    assert "impactlaw.stepper" in loaded
    assert module not in loaded


def test_deferred_names_are_scipys():
    from scipy.optimize import nnls

    from impactlaw import deferred

    assert deferred.nnls is nnls
    for name in deferred._HOME:
        assert callable(getattr(deferred, name))
    with pytest.raises(AttributeError, match="no attribute 'nnsl'"):
        deferred.nnsl  # noqa: B018
