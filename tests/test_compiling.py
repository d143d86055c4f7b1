"""Processes that share the work of compiling."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import impactlaw
from impactlaw.compiling import start_helpers
from impactlaw.locks import alone

pytest.importorskip("fcntl", reason="on Windows each process compiles for itself")

_MODULE = """
from impactlaw.compiled import compiled
from impactlaw.linked import by_address, linked
from impactlaw.solvers.cones.algebra.loops import plain

@plain
def thrice(x):
    return 3.0 * x

@compiled("float64(float64)")
def double(x):
    return 2.0 * x

_double = by_address(double)

@linked("float64(float64)")
def same(x):
    return x

def real(x):
    return x.real

@compiled("(float64,)")
def half(x):
    return x / 2.0

@compiled("float64(float64)")
def five_halves(x):
    return _double(same(x)) + half(x)
"""
_CALLED = """
import dis, sys
from importlib import import_module
from impactlaw.compiling import LATER, Declared
LATER.set([])
import_module(sys.argv[1])
functions = [f for name, module in list(sys.modules.items()) if name.startswith("impactlaw.")
             for f in vars(module).values() if hasattr(f, "py_func")] + LATER.get()
asked = 0
for f in functions:
    f = getattr(f, "py_func", None) or f.__closure__[[*f.__code__.co_freevars].index("function")].cell_contents
    for name in {i.argval for i in dis.get_instructions(f) if i.opname == "LOAD_GLOBAL"}:
        asked += 1
        if isinstance(f.__globals__.get(name), Declared):
            print(f"{f.__module__}.{f.__name__} calls {name}")
assert asked > 100, asked
"""
_CALL = """
from impactlaw.copied import five_halves, same
print(five_halves(2.0))
try:
    same(2.0)
except NotImplementedError as error:
    print(error)
"""
_READ = """
from impactlaw.copied import double, five_halves, half
print(five_halves(2.0), *(sum(f.stats.cache_hits.values()) for f in (double, half, five_halves)))
"""


def _run(code: str, copy: Path) -> str:
    environment = os.environ | {"PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(copy / "cache")}
    command = [sys.executable, "-P", "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=True).stdout


@pytest.fixture
def copy(tmp_path):
    shutil.copytree(Path(impactlaw.__file__).parent, tmp_path / "impactlaw", ignore=shutil.ignore_patterns("envs"))
    (tmp_path / "impactlaw" / "copied.py").write_text(_MODULE)
    return tmp_path


def test_one_process_at_a_time_holds_a_file(tmp_path):
    with alone(tmp_path / "lock") as first, alone(tmp_path / "lock", wait=False) as second:
        assert first
        assert not second
    with alone(tmp_path / "lock", wait=False) as again:
        assert again


@pytest.mark.parametrize("wait", [True, False])
def test_where_no_file_can_be_created_nobody_waits_and_nobody_helps(tmp_path, wait):
    with alone(tmp_path / "missing" / "lock", wait=wait) as goes_on:
        assert goes_on is wait


_HELP = """
from impactlaw.compiled import cache_folder, help_with
from impactlaw.locks import alone
with alone(cache_folder() / "{}"):
    help_with("impactlaw.copied", str(cache_folder() / "helper_0.lock"))
"""


def test_only_compiled_functions_call_what_is_linked(copy):
    compiles, loads = (_run(_CALL, copy).split("\n")[:2] for _ in range(2))
    assert compiles == loads
    assert compiles[0] == "5.0"
    assert "pure-python" in compiles[1]


def test_what_nobody_compiled_is_not_found(copy):
    assert _run(_READ, copy).split() == ["5.0", "0", "0", "0"]


@pytest.mark.parametrize(
    ("held", "found"),
    [
        ("nothing", ["1", "1", "1"]),
        ("impactlaw.copied.five_halves.lock", ["1", "1", "0"]),
        ("helper_0.lock", ["0", "0", "0"]),
    ],
)
def test_a_helper_compiles_what_no_other_process_is_at(copy, held, found):
    """Nor does it compile if there is a helper with its number already."""
    _run(_HELP.format(held), copy)
    assert _run(_READ, copy).split() == ["5.0", *found]


_INTERRUPTED = """
import signal
from numba import types
from numba.core.typing.context import BaseContext
from impactlaw.compiled import compiled
fill, interrupts = BaseContext.insert_attributes, []

def interrupted(self, attributes):
    if attributes.key is types.Number and not interrupts:
        interrupts.append(attributes)
        signal.raise_signal(signal.SIGINT)
    fill(self, attributes)

BaseContext.insert_attributes = interrupted
try:
    import impactlaw.copied
    print("not interrupted")
except KeyboardInterrupt:
    from impactlaw.copied import five_halves, real
    print(five_halves(2.0), compiled("float64(float64)")(real)(3.0))
"""


def test_after_an_interrupt_functions_are_compiled_by_the_next_attempt(copy):
    """As in a notebook, where one stops the cell that compiles, and runs it again."""
    assert _run(_INTERRUPTED, copy) == "5.0 3.0\n"


_FOR_PYTHON = """
import sys
from impactlaw.copied import thrice
from impactlaw.compiled import _tell, for_python
_tell.cache_clear()
sys.stderr = sys.stdout
print(for_python(thrice)(2.0))
"""
_STEPS = """
import mujoco
from impactlaw import Moreau, Stepper
from impactlaw.compiled import for_python
model = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .11"><freejoint/><geom size=".1"/></body>'
    '</worldbody></mujoco>')
data = mujoco.MjData(model)
stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
while not stepper.sums.count:
    stepper.step(data)
print(for_python.cache_info().currsize)
"""


def test_what_only_python_calls_is_announced_when_it_is_compiled(copy):
    _run(_CALL, copy)
    told, said = _run(_FOR_PYTHON, copy).split("\n")[:2]
    assert told.startswith("impactlaw: compiling")
    assert said == "6.0"
    assert _run(_FOR_PYTHON, copy) == "6.0\n"


def test_compiled_steps_need_nothing_that_is_compiled_for_steps_in_python():
    said = subprocess.run([sys.executable, "-c", _STEPS], capture_output=True, text=True, timeout=600, check=True)
    assert said.stdout == "0\n"


def test_a_python_that_cannot_be_started_again_compiles_alone(monkeypatch, tmp_path):
    monkeypatch.setattr("joblib.cpu_count", lambda: 2)  # first, because joblib keeps the path of Python
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    start_helpers("impactlaw.solvers.cones.solve", tmp_path)


@pytest.mark.parametrize(
    "module",
    [
        "impactlaw.solvers.cones.solve",
        "impactlaw.stepping.time_stepping.compiled.entry",
        "impactlaw.stepping.soft.compiled.entry",
        "impactlaw.stepping.soft.compiled.batch_entry",
    ],
)
def test_nothing_calls_a_function_that_a_helper_has_put_off(module):
    """Except by its address: numba cannot compile a caller, and the helper would end without any result."""
    command = [sys.executable, "-c", _CALLED, module]
    assert subprocess.run(command, capture_output=True, text=True, timeout=600, check=True).stdout == ""


def test_what_is_only_imported_compiles_nothing(tmp_path):
    """Otherwise `--help` of a script would take minutes."""
    root = Path(__file__).parents[1]
    scripts = [f"scripts.{path.parent.name}.__main__" for path in sorted(root.glob("scripts/*/__main__.py"))]
    assert len(scripts) > 5
    code = "import sys; from importlib import import_module; [import_module(name) for name in sys.argv[1:]]"
    modules = ["impactlaw.cli", "impactlaw.batch", "impactlaw.envs", *scripts]
    environment = os.environ | {"PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code, *modules], env=environment, capture_output=True, text=True, timeout=600, check=True
    )
    assert "compiling" not in done.stderr
    assert not list(tmp_path.rglob("*.nbi"))
