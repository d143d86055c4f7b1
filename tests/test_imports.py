"""``import impactlaw`` loads no package that a simulation may not need."""

import importlib.metadata
import subprocess
import sys

import pytest

import impactlaw

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
    assert "impactlaw.stepping.stepper" in loaded
    assert module not in loaded


def test_no_step_waits_for_an_import():
    code = """
import sys
from impactlaw import Stepper, make_law
from impactlaw.models import load
model, data = load("newtons_cradle")
stepper = Stepper(model, make_law("reversal", 1.0))
before = set(sys.modules)
stepper.step(data)
assert stepper.events
print(*(name for name in set(sys.modules) - before if name.startswith("scipy")))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_package_tells_its_version():
    assert impactlaw.__version__ == importlib.metadata.version("impactlaw")
