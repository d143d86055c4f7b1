"""Running studies: every cell once, also after kills, with the same table on every backend."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from impactlaw.errors import StudyError
from impactlaw.studies import Study, run
from impactlaw.studies.store import write

TASK = "impactlaw/Billiards-v0"  # the shortest episodes
FAST = Study(
    tasks=(TASK,), train=("moreau:0.5",), act=("moreau:0.5", "reversal:1"), policies=("scripted",), seeds=(0, 1),
    episodes=1,
)  # fmt: skip
TESTS = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def table(tmp_path_factory) -> pd.DataFrame:
    return run(FAST, tmp_path_factory.mktemp("fast"), backend="sequential", jobs=1)


def test_there_is_a_row_for_each_cell_in_the_order_of_the_study(table):
    cells = [(law, seed) for law in FAST.act for seed in FAST.seeds]
    assert list(zip(table["acted_under"], table["seed"], strict=True)) == cells
    assert set(table["policy"]) == {"scripted"}
    assert set(table["scheme"]) == {"event-driven"}
    assert (table["score"] > 0).any()
    assert (table["collisions"] > 1).all()


def test_the_table_is_kept_as_parquet(table, tmp_path):
    again = run(FAST, tmp_path, jobs=1)
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "table.parquet"), again, check_exact=True)
    pd.testing.assert_frame_equal(again, table, check_exact=True)


@pytest.mark.parametrize("backend", ["loky", "threading", "dask", "ray"])
def test_the_table_is_the_same_from_every_backend(backend, table, tmp_path):
    package = {"dask": "distributed"}.get(backend, backend)
    if backend in ("dask", "ray") and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    (tmp_path / "main.py").write_text(
        "from impactlaw.studies import Study, run\n"
        "if __name__ == '__main__':\n"
        f"    run({FAST!r}, '.', backend={backend!r}, jobs=2)\n"
    )
    done = subprocess.run(
        [sys.executable, "main.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "table.parquet"), table, check_exact=True)


SLOW = """
from impactlaw.studies import Study, run
study = Study(tasks=("impactlaw/Billiards-v0",), act=("moreau:0.5", "moreau:0.9", "reversal:1"),
              policies=("studies.acting:Slow",), seeds=(0, 1), episodes=2)
run(study, "out", jobs=1)
"""


def test_a_killed_study_goes_on_and_does_nothing_twice(tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])}

    def start(folder: Path) -> subprocess.Popen:
        folder.mkdir(exist_ok=True)
        own = environment | {"STUDIES_BEGUN": str(folder / "begun")}
        return subprocess.Popen([sys.executable, "-c", SLOW], cwd=folder, env=own, stderr=subprocess.DEVNULL)

    killed = tmp_path / "killed"
    with start(killed) as process:
        deadline = time.monotonic() + 120
        while len(list(killed.glob("out/cells/*.json"))) < 2 and time.monotonic() < deadline:
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
    kept = {path: path.stat().st_mtime_ns for path in killed.glob("out/cells/*.json")}
    assert 2 <= len(kept) < 6
    assert not (killed / "out/table.parquet").exists()
    with start(killed) as process, start(tmp_path / "whole") as other:
        assert process.wait(120) == 0
        assert other.wait(120) == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    begun = len((killed / "begun").read_text().splitlines())
    assert 12 <= begun <= 14  # 6 cells of 2 episodes, and those of the cell that was killed
    tables = [pd.read_parquet(tmp_path / name / "out/table.parquet") for name in ("killed", "whole")]
    pd.testing.assert_frame_equal(*tables, check_exact=True)


def test_more_of_a_study_makes_only_what_is_new(table, tmp_path):
    run(FAST, tmp_path, backend="sequential", jobs=1)
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()}
    more = Study(**{**vars(FAST), "act": ("moreau:0.9", *FAST.act)})
    longer = run(more, tmp_path, backend="sequential", jobs=1)
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()}
    assert {name: after[name] for name in before} == before
    assert len(after) == len(before) + 2
    rest = longer[longer["acted_under"] != "moreau:0.9"].reset_index(drop=True)
    pd.testing.assert_frame_equal(rest, table, check_exact=True)


def test_an_edited_policy_is_another_one(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # bytecode of the same second would pass for current
    monkeypatch.syspath_prepend(tmp_path)
    module = tmp_path / "mine_to_edit.py"
    study = Study(tasks=(TASK,), act=("moreau:0.5",), policies=("mine_to_edit:act",), seeds=(0,), episodes=1)
    scores = []
    for speed in ("-1.0", "1.00"):
        module.write_text(f"def act(observation):\n    return 0.0, {speed}\n")
        sys.modules.pop("mine_to_edit", None)
        importlib.invalidate_caches()
        import linecache

        linecache.clearcache()
        scores.append(run(study, tmp_path / "out", backend="sequential", jobs=1)["highest"].item())
    assert len(list((tmp_path / "out/cells").iterdir())) == 2
    assert scores[0] != scores[1]


def test_a_cell_that_fails_is_named_and_the_others_are_kept(tmp_path):
    study = Study(
        tasks=(TASK,), act=("moreau:0.5",), policies=("studies.acting:fall_over", "studies.acting:stay"), seeds=(0,),
        episodes=1,
    )  # fmt: skip
    with pytest.raises(StudyError, match=r"1 cell has failed.*fall_over on \S+ under moreau:0.5.*fell"):
        run(study, tmp_path, backend="sequential", jobs=1)
    assert len(list((tmp_path / "cells").iterdir())) == 1


def test_a_broken_file_is_named(tmp_path):
    run(FAST, tmp_path, backend="sequential", jobs=1)
    path = next((tmp_path / "cells").iterdir())
    for text in ("{", "[]", '{"row": [1]}'):
        path.write_text(text)
        with pytest.raises(StudyError, match=path.name):
            run(FAST, tmp_path, backend="sequential", jobs=1)


def test_a_file_that_cannot_be_written_leaves_none_of_another_name(tmp_path):
    (tmp_path / "table.parquet").mkdir()
    with pytest.raises(StudyError, match=r"cannot write .*table\.parquet"):
        write(tmp_path / "table.parquet", b"x")
    assert [path.name for path in tmp_path.iterdir()] == ["table.parquet"]


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="cannot write"):
        run(FAST, tmp_path / "file" / "out", backend="sequential", jobs=1)
