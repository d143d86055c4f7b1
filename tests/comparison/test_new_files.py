"""Sets of files that are either complete or not written at all."""

import pytest

from impactlaw.comparison.new_files import new_files_in
from impactlaw.errors import SceneError


def test_interrupted_work_leaves_nothing_behind(tmp_path):
    kept = tmp_path / "results"
    with pytest.raises(KeyboardInterrupt), new_files_in(kept) as folder:
        (folder / "table.csv").write_text("half")
        raise KeyboardInterrupt
    assert not kept.exists()


def test_new_results_replace_old_ones_only_when_complete(tmp_path):
    with new_files_in(tmp_path) as folder:
        (folder / "table.csv").write_text("old")
    with pytest.raises(RuntimeError), new_files_in(tmp_path) as folder:
        (folder / "table.csv").write_text("half")
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]
    assert (tmp_path / "table.csv").read_text() == "old"


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SceneError, match="cannot write"), new_files_in(tmp_path / "file" / "out"):
        pass


def test_results_do_not_replace_a_folder_and_none_of_them_is_moved(tmp_path):
    (tmp_path / "table.csv").mkdir()
    with pytest.raises(SceneError, match="there is a folder of that name"), new_files_in(tmp_path) as folder:
        for name in ("a.csv", "table.csv", "z.csv"):
            (folder / name).write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_the_error_is_told_where_somebody_else_has_put_something_into_the_new_folder(tmp_path):
    kept = tmp_path / "out" / "results"
    with pytest.raises(SceneError, match="this is wrong"), new_files_in(kept) as folder:
        (folder / "table.csv").write_text("half")
        (tmp_path / "out" / "study").mkdir()
        raise SceneError("this is wrong")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["study"]
