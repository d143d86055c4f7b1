"""What ``import impactlaw`` loads: nothing that a simulation may never use."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
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
    assert "impactlaw.stepping.stepper" in loaded
    assert module not in loaded


def test_deferred_names_are_scipys():
    from scipy.optimize import nnls

    from impactlaw import deferred

    assert deferred.nnls is nnls
    for name in deferred._HOME:
        assert callable(getattr(deferred, name))
    with pytest.raises(AttributeError, match="no attribute 'nnsl'"):
        deferred.nnsl  # noqa: B018


@pytest.mark.parametrize("shape", [(6, 4), (3, 8), (24, 16)])
def test_nnls_without_its_checks_is_nnls(shape):
    """The routine that is not public gives what the public one gives, and gives up where that does."""
    from scipy.optimize import nnls

    from impactlaw import deferred

    solved = 0
    for seed in range(20):
        rng = np.random.default_rng([57, *shape, seed])
        A, b = rng.normal(size=shape), rng.normal(size=shape[0])
        for changes in (1, 30 * shape[1]):
            try:
                expected = nnls(A, b, maxiter=changes)
            except RuntimeError:
                expected = None
            for routine in (deferred.unchecked_nnls, deferred._checked_nnls):
                given = A.copy(), b.copy()
                found, distance, ended = routine(*given, changes)
                assert (ended == deferred.ENDED) == (expected is not None)
                if expected is not None:
                    np.testing.assert_array_equal(found, expected[0])
                    assert distance == expected[1]
                np.testing.assert_array_equal(given[0], A)
                np.testing.assert_array_equal(given[1], b)
            solved += expected is not None
    assert solved >= 10


def test_another_scipy_has_its_public_nnls(monkeypatch):
    """The routine behind it may be gone, take something else, or end in another way."""
    from impactlaw import deferred

    def gone(name):
        raise ModuleNotFoundError(name)

    def other(A, b):
        return np.ones(1), 0.0, 1

    def quiet(A, b, changes):
        return np.full(1, 0.5), 0.0, 1

    modules = [gone, lambda _: object()] + [lambda _, f=f: SimpleNamespace(_nnls=f) for f in (other, quiet)]
    for module in modules:
        monkeypatch.setattr(deferred, "import_module", module)
        assert deferred._unchecked_nnls() is deferred._checked_nnls


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
