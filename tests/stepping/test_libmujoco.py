"""Which library of MuJoCo compiled code calls."""

from __future__ import annotations

import mujoco
import pytest

from impactlaw.stepping.compiled.libmujoco import find_library


@pytest.mark.parametrize("form", ["libmujoco.so.{}", "libmujoco.{}.dylib"])
def test_the_library_is_that_of_the_bindings_beside_one_that_another_version_has_left(tmp_path, form):
    version = mujoco.mj_versionString()
    for name in (form.format("1.0.0"), form.format(version), form.format("99.0.0"), "libmujoco.md"):
        (tmp_path / name).touch()
    assert find_library(tmp_path).name == form.format(version)


def test_a_library_without_a_version_in_its_name_is_found(tmp_path):
    (tmp_path / "mujoco.dll").touch()
    assert find_library(tmp_path).name == "mujoco.dll"
