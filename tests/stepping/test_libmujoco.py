"""The library of MuJoCo that compiled code calls, and callbacks that MuJoCo makes meanwhile."""

from __future__ import annotations

import ctypes
import sys

import mujoco
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.models import load
from impactlaw.stepping.compiled.layout import table
from impactlaw.stepping.compiled.libmujoco import find_library, is_called_back, library, without_callbacks

CALLBACKS = ("control", "passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor")


@pytest.fixture(autouse=True)
def _clean():
    yield
    for name in CALLBACKS:
        getattr(mujoco, f"set_mjcb_{name}")(None)


@pytest.mark.parametrize("form", ["libmujoco.so.{}", "libmujoco.{}.dylib"])
def test_the_library_is_that_of_the_bindings_beside_one_that_another_version_has_left(tmp_path, form):
    version = mujoco.mj_versionString()
    for name in (form.format("1.0.0"), form.format(version), form.format("99.0.0"), "libmujoco.md"):
        (tmp_path / name).touch()
    assert find_library(tmp_path).name == form.format(version)


def test_a_library_without_a_version_in_its_name_is_found(tmp_path):
    (tmp_path / "mujoco.dll").touch()
    assert find_library(tmp_path).name == "mujoco.dll"


def addresses():
    return [ctypes.c_size_t.in_dll(library(), f"mjcb_{name}").value for name in CALLBACKS]


def test_callbacks_are_taken_off_and_put_back():
    functions = [lambda *given, name=name: name for name in CALLBACKS]
    for name, function in zip(CALLBACKS, functions, strict=True):
        getattr(mujoco, f"set_mjcb_{name}")(function)
    before = addresses()

    def fail():
        assert not any(addresses())
        raise KeyError

    with pytest.raises(KeyError):
        without_callbacks(fail)
    assert [getattr(mujoco, f"get_mjcb_{name}")() for name in CALLBACKS] == functions
    assert without_callbacks(is_called_back) is False
    assert addresses() == before
    assert is_called_back()


def test_a_callback_that_was_set_from_c_is_put_back():
    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda model, data: None)
    place = ctypes.c_size_t.in_dll(library(), "mjcb_control")
    place.value = address = ctypes.cast(function, ctypes.c_void_p).value
    assert without_callbacks(lambda: place.value) == 0
    assert place.value == address


def test_interrupts_at_any_time_leave_callbacks_on():
    """Python raises interrupts where functions begin, and after calls: a profiler raises one at each of these."""
    for name in CALLBACKS:
        getattr(mujoco, f"set_mjcb_{name}")(lambda *given: 0)
    table()
    before, interrupts = addresses(), 0
    for last in range(1, 200):
        left = last

        def raise_at_last(frame, event, argument):
            nonlocal left
            left -= event in ("call", "c_return")
            if not left:
                raise KeyboardInterrupt

        sys.setprofile(raise_at_last)
        try:
            without_callbacks(lambda: max(map(abs, range(10))))
        except KeyboardInterrupt:
            interrupts += 1
        finally:
            sys.setprofile(None)
        assert addresses() == before
    assert 2 < interrupts < 199  # at all of them


@pytest.mark.parametrize("name", ["control", "passive", "contactfilter"])
@pytest.mark.parametrize(
    "way",
    [
        {},
        {"scheme": "time-stepping"},
        {"contact_model": "soft"},
        {"contact_model": "soft", "compiled": "never"},
    ],
    ids=str,
)
def test_steppers_are_made_while_a_callback_is_set_that_is_for_another_scene(way, name):
    """It is not called for the scenes with which this package tests compiled code at first use."""
    (model, data), heard = load("box_drop"), []
    table.cache_clear()

    def callback(model: mujoco.MjModel, *given: object) -> int:
        heard.append(model.names)
        return 0

    getattr(mujoco, f"set_mjcb_{name}")(callback)
    Stepper(model, Moreau(0.5), **way).step(data)
    assert set(heard) <= {model.names}
    assert getattr(mujoco, f"get_mjcb_{name}")() is callback
