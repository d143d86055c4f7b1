"""The cache of compiled functions."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import impactlaw

_USE = """
import numpy as np
from impactlaw.compiled import cache_folder, compiled

@compiled("float64(float64)")
def double(x):
    return 2.0 * x

print(double(1.0), sum(double.stats.cache_hits.values()), cache_folder())
"""
"""A function of a module of the package, of which only the files that name the cache exist."""


def _run(copy: Path, cache: Path) -> list[str]:
    environment = os.environ | {"PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", "import impactlaw.doubling"]
    done = subprocess.run(command, env=environment, cwd=copy, capture_output=True, text=True, timeout=600, check=True)
    return done.stdout.split()


def test_another_copy_of_the_package_finds_what_is_compiled(tmp_path):
    found = []
    for name in ("one", "other"):
        copy = tmp_path / name
        shutil.copytree(Path(impactlaw.__file__).parent, copy / "impactlaw", ignore=shutil.ignore_patterns("envs"))
        (copy / "impactlaw" / "doubling.py").write_text(_USE)
        found.append(_run(copy, tmp_path / "cache"))
    assert [answer[:2] for answer in found] == [["2.0", "0"], ["2.0", "1"]]
    assert found[0][2] == found[1][2]


def test_other_sources_have_another_cache(tmp_path):
    copy = tmp_path / "one"
    shutil.copytree(Path(impactlaw.__file__).parent, copy / "impactlaw", ignore=shutil.ignore_patterns("envs"))
    (copy / "impactlaw" / "doubling.py").write_text(_USE)
    before = _run(copy, tmp_path / "cache")
    source = copy / "impactlaw" / "solvers" / "cones" / "newton.py"
    source.write_text(source.read_text() + "\n_MORE = 1\n")
    after = _run(copy, tmp_path / "cache")
    assert after[:2] == ["2.0", "0"]
    assert after[2] != before[2]


def test_another_version_of_a_file_is_compiled_again(tmp_path):
    copy = tmp_path / "one"
    shutil.copytree(Path(impactlaw.__file__).parent, copy / "impactlaw", ignore=shutil.ignore_patterns("envs"))
    source = copy / "impactlaw" / "doubling.py"
    source.write_text(_USE)
    before = _run(copy, tmp_path / "cache")
    source.write_text(_USE.replace("2.0 * x", "3.00 * x"))  # another size: Python tells bytecode apart by it
    after = _run(copy, tmp_path / "cache")
    assert [before[:2], after[:2]] == [["2.0", "0"], ["3.0", "0"]]
    assert after[2] == before[2]


_NO_HOME = """
import os, pathlib
os.environ.pop("NUMBA_CACHE_DIR"), os.environ.pop("XDG_CACHE_HOME", None), os.environ.pop("HOME", None)
os.path.expanduser = lambda path: path  # as for a user without an entry in the list of users
"""
_NO_ROOM = """
import resource, sys
sys.dont_write_bytecode = True  # Python would keep the part of it that has room
resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))  # writes fail as on a full disk
"""
_ONLY_READ = """
import os
def refuse(*arguments, **options):
    raise PermissionError(13, "Permission denied")
os.access, os.open, os.mkdir = lambda *arguments, **options: False, refuse, refuse
"""


def _run_where(how: str, copy: Path, cache: Path) -> tuple[list[str], str]:
    (copy / "impactlaw" / "doubling.py").write_text(_USE)
    environment = os.environ | {"PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(cache)}
    code = f"import impactlaw.compiling\n{how}\nimport impactlaw.doubling"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=copy, capture_output=True, text=True, timeout=600, check=True
    )
    return done.stdout.split(), done.stderr


@pytest.mark.parametrize(
    ("how", "reason"),
    [(_NO_HOME, "no folder that can be written"), (_NO_ROOM, "File too large"), (_ONLY_READ, "no folder that can be")],
)
def test_without_a_cache_each_process_compiles_and_says_why(tmp_path, how, reason):
    copy = tmp_path / "one"
    shutil.copytree(Path(impactlaw.__file__).parent, copy / "impactlaw", ignore=shutil.ignore_patterns("envs"))
    found, said = _run_where(how, copy, tmp_path / "cache")
    assert found[:2] == ["2.0", "0"]
    assert "in every process anew" in said
    assert reason in said


def test_a_cache_is_filled_once_there_is_room_and_is_read_where_it_can_only_be_read(tmp_path):
    copy = tmp_path / "one"
    shutil.copytree(Path(impactlaw.__file__).parent, copy / "impactlaw", ignore=shutil.ignore_patterns("envs"))
    _run_where(_NO_ROOM, copy, tmp_path / "cache")
    found, said = _run_where("", copy, tmp_path / "cache")
    assert found[:2] == ["2.0", "0"]
    assert "in every process anew" not in said
    found, said = _run_where(_ONLY_READ, copy, tmp_path / "cache")
    assert found[:2] == ["2.0", "1"]
    assert not said
