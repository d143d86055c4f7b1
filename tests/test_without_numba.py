"""What runs where compiled code cannot be used: without numba, or if MuJoCo's structures are not as it says."""

import os
import subprocess
import sys
from textwrap import dedent

import pytest

from impactlaw import Moreau, Stepper
from impactlaw.errors import UncompilableError, UncompiledWarning
from impactlaw.models import load

BLOCKED = """
    import sys

    class Blocked:
        def find_spec(self, name, path=None, target=None):
            if name.partition(".")[0] in ("numba", "llvmlite"):
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    sys.meta_path.insert(0, Blocked())

    import mujoco
    import impactlaw
    from impactlaw import Moreau, Stepper

    BALL = '''<mujoco><option integrator="RK4"/><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 .2"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'''
    model = mujoco.MjModel.from_xml_string(BALL)

    def top(**options):
        data = mujoco.MjData(model)
        stepper = Stepper(model, Moreau(0.5), **options)
        while not stepper.events:
            stepper.step(data)
        while data.qvel[2] > 0:
            stepper.step(data)
        return data.qpos[2] - 0.1
"""


def without_numba(code: str) -> str:
    """Run code in a process that cannot import numba, with a ball 0.1 m above a floor, and return what it prints."""
    run = subprocess.run(
        [sys.executable, "-c", dedent(BLOCKED) + dedent(code)], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_event_driven_and_soft_steps_need_no_numba():
    told = without_numba(
        """
        print(top(), top(contact_model="soft"), top(contact_model="soft", compiled="never"))
        """
    )
    rigid, soft, python = map(float, told.split())
    assert abs(rigid - 0.025) < 1e-4
    assert abs(soft - 0.025) < 3e-3
    assert soft == python


def test_an_explicit_wish_for_compiled_steps_is_answered_by_a_warning():
    told = without_numba(
        """
        import warnings
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            Stepper(model, Moreau(0.5), contact_model="soft", compiled="auto")
        print(*[f"{each.category.__name__}: {each.message}" for each in caught])
        """
    )
    assert told.startswith("UncompiledWarning: steps are not compiled, but in Python: numba cannot be imported")


def test_time_stepping_and_batches_say_that_they_need_numba():
    told = without_numba(
        """
        for make in (
            lambda: Stepper(model, Moreau(0.5), scheme="time-stepping"),
            lambda: Stepper(model, Moreau(0.5), scheme="time-stepping", compiled="never"),
            lambda: impactlaw.Batch(model, Moreau(0.5), 2),
        ):
            try:
                make()
            except impactlaw.ImpactLawError as error:
                print(type(error).__name__, error)
        """
    )
    lines = told.splitlines()
    assert len(lines) == 3
    for line in lines:
        assert line.startswith("UncompilableError numba cannot be imported (No module named 'numba")
        assert "pip install" in line


def test_the_setting_by_which_numba_does_not_compile_is_like_no_numba():
    code = """
        from impactlaw import ImpactLawError, Moreau, Stepper
        from impactlaw.models import load
        model, data = load("box_drop")
        Stepper(model, Moreau(0.5), contact_model="soft").step(data)
        try:
            Stepper(model, Moreau(0.5), scheme="time-stepping")
        except ImpactLawError as error:
            print(type(error).__name__, error)
        """
    run = subprocess.run(
        [sys.executable, "-c", dedent(code)],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("UncompilableError numba compiles nothing, since NUMBA_DISABLE_JIT is set")


def test_structures_that_are_elsewhere_are_not_stepped_in_compiled_code(monkeypatch):
    """Soft steps are in Python then; time stepping, which has no steps in Python, says what is wrong."""

    def table() -> None:
        raise UncompilableError("MuJoCo keeps qpos elsewhere than it says")

    monkeypatch.setattr("impactlaw.stepping.compiled.one_world.table", table)
    model, data = load("box_drop")
    with pytest.warns(UncompiledWarning, match="in Python: MuJoCo keeps qpos elsewhere"):
        stepper = Stepper(model, Moreau(0.5), compiled="auto", contact_model="soft")
    stepper.step(data)
    assert type(stepper.stepping).__name__ == "SoftStepping"
    for compiled in ("auto", "never"):
        with pytest.raises(UncompilableError, match="MuJoCo keeps qpos elsewhere"):
            Stepper(model, Moreau(0.5), compiled=compiled, scheme="time-stepping")
