"""Malformed files of collisions, and options that do not fit, are reported in one line."""

import json

import numpy as np
import pytest
from identification.tables import chain_rows, row, run_cli, table

from impactlaw import Collision, make_law
from impactlaw.errors import MeasurementError, RestitutionError
from impactlaw.identification import read_collisions


@pytest.mark.parametrize(
    ("text", "message"),
    [(None, "cannot read a law"), ("{", "is not JSON"), ("[1]", "holds no law"), ('{"law": 3}', "holds no law")],
)
def test_files_that_hold_no_law(tmp_path, text, message):
    path = tmp_path / "law.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(RestitutionError, match=message):
        make_law(path)


def changed(number=0, **cells):
    """Return the rows of a chain, with other cells in one of them; None removes the column."""
    rows = chain_rows()
    for name, cell in cells.items():
        if cell is None:
            for one in rows:
                one.pop(name)
        else:
            rows[number][name] = cell if isinstance(cell, str) else json.dumps(cell)
    return rows


def scaled(factor):
    rows = chain_rows()
    for one in rows:
        one["post_contact_velocity"] = json.dumps(
            (factor * np.array(json.loads(one["post_contact_velocity"]))).tolist()
        )
    return rows


def full(**cells):
    one = {
        "mass_matrix": [[1.0, 0.0], [0.0, 1.0]],
        "jacobian": [[1.0, 0.0]],
        "pre_velocity": [-1.0, 0.0],
        "post_velocity": [0.5, 0.0],
    } | cells
    return [{name: json.dumps(value) for name, value in one.items()}] * 3


def still():
    rows = chain_rows()
    for one in rows[:1]:
        one["pre_contact_velocity"] = "[0.0, 0.0]"
    return rows


MALFORMED = {
    "no such column": (changed(pre_contact_velocity=None), "has no column pre_contact_velocity"),
    "other columns": ([{"x": 1, "y": 2}], "has no column .*, this one has 'x', 'y'"),
    "one column": ([{"mass_matrix": "[[1]]"}], "has no column jacobian, pre_velocity, post_velocity"),
    "NaN": (changed(3, post_contact_velocity="[NaN, 1.0]"), "row 3: post_contact_velocity has entries that"),
    "infinite": (changed(pre_contact_velocity="[-Infinity, 0.0]"), "row 0: pre_contact_velocity has entries that"),
    "empty cell": (changed(2, post_contact_velocity=""), "row 2: post_contact_velocity"),
    "words": (changed(1, pre_contact_velocity="fast"), "row 1: pre_contact_velocity is not numbers: fast"),
    "ragged": (changed(1, delassus="[[1, 2], [3]]"), "row 1: delassus is not numbers"),
    "too few after": (changed(post_contact_velocity=[1.0]), "row 0: 2 contact velocities before, 1 after"),
    "too many labels": (changed(contacts=["a", "b", "c"]), "row 0: 3 contacts"),
    "wrong matrix": (changed(delassus=[[1.0]]), "row 0: delassus has 1 numbers, 2 contacts need 4"),
    "not symmetric": (changed(delassus=[[1.0, 0.5], [0.0, 1.0]]), "row 0: delassus is not symmetric"),
    "negative": (changed(delassus=[[-1.0, 0.0], [0.0, 1.0]]), "row 0: delassus is not positive"),
    "indefinite": (changed(delassus=[[1.0, 2.0], [2.0, 1.0]]), "row 0: delassus is not positive"),
    "singular": (changed(delassus=[[1.0, 1.0], [1.0, 1.0]]), "row 0: no motion of these contacts"),
    "neither matrix nor impulses": (changed(delassus=None, impulse=None), "have neither delassus nor impulses"),
    "wrong impulses": (changed(delassus=None, impulse=[1.0]), "row 0: 1 impulses for 2 contacts"),
    "too few for a matrix": (
        [{k: v for k, v in one.items() if k != "delassus"} for one in chain_rows(1)] * 2,
        "too few, or too alike, .* write a table that has it in a column delassus, .*up to 64 contacts",
    ),
    "no matrix explains it": (changed(delassus=None, impulse=[5.0, -3.0]), "no Delassus matrix explains"),
    "one row": (chain_rows(1), "has 1 collision"),
    "no rows": ([], "cannot be read as a table|has no collisions"),
    "mixed sets": (chain_rows() + [row(Collision([[1.0]], [[1.0]], [-1.0], labels=("x",)), [0.5])] * 3, "one set of"),
    "units": (scaled(1000.0), "only 0% of 12 collisions are admissible"),
    "signs": (scaled(-1.0), "only 0% of 12 collisions are admissible"),
    "at rest": (still(), "has no motion of its contacts"),
    "mass not positive": (full(mass_matrix=[[1.0, 0.0], [0.0, -1.0]]), "row 0: mass_matrix is not positive definite"),
    "mass not square": (full(mass_matrix=[[1.0, 0.0]]), "row 0: mass_matrix must be square"),
    "gradients of another size": (full(jacobian=[[1.0, 0.0, 0.0]]), "row 0: jacobian must have shape"),
    "gradients flat": (full(jacobian=[1.0, 0.0]), "row 0: jacobian must be a list of rows"),
    "velocity too long": (full(post_velocity=[1.0, 2.0, 3.0]), "row 0: post_velocity has 3 numbers, pre_velocity 2"),
    "friction of another size": (full(friction_jacobian=[[1.0]]), "row 0: friction jacobian must have 2 columns"),
    "friction of no contact": (
        full(friction_jacobian=[[0.0, 1.0]], friction_contact=[4]), "row 0: friction of contact 4, but there are 1"
    ),
    "half a contact": (full(friction_jacobian=[[0.0, 1.0]], friction_contact=[0.5]), "must be whole numbers"),
    "negative friction": (
        full(friction_jacobian=[[0.0, 1.0]], friction_coefficient=[-1.0]), "row 0: a friction coefficient must be"
    ),
    "half a contact of sliding": (
        changed(pre_sliding_velocity=[1.0], post_sliding_velocity=[0.5], friction_contact=[0.5]),
        "row 0: friction_contact must be whole numbers",
    ),
    "wrong friction impulses": (
        changed(
            delassus=None, pre_sliding_velocity=[1.0], post_sliding_velocity=[0.5],
            impulse=[1.0, 1.0], friction_impulse=[0.1, 0.2],
        ),
        "row 0: 2 friction impulses for 1 sliding velocities",
    ),
    "coefficients of other rows": (
        changed(
            delassus=np.eye(4).tolist(), pre_sliding_velocity=[1.0, 1.0], post_sliding_velocity=[0.5, 0.5],
            friction_coefficient=[0.1, 0.2, 0.3],
        ),
        "row 0: 3 friction coefficients for 2 rows of friction",
    ),
    "too few coefficients": (
        changed(
            delassus=np.eye(5).tolist(), pre_sliding_velocity=[1.0] * 3, post_sliding_velocity=[0.5] * 3,
            friction_coefficient=[0.1, 0.2],
        ),
        "row 0: 2 friction coefficients for 3 rows of friction",
    ),
    "sliding before only": (changed(pre_sliding_velocity=[1.0]), "row 0: post_sliding_velocity"),
}  # fmt: skip


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_tables_are_told_in_one_line(tmp_path, monkeypatch, capsys, name):
    rows, message = MALFORMED[name]
    path = table(tmp_path / "data.csv", rows)
    family = ("--family", "fremond") if name == "mixed sets" else ()
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, "--out", tmp_path / "law.json", *family)
    assert code == 2
    assert said.startswith("impactlaw: ")
    assert said.count("\n") == 1
    assert pytest.importorskip("re").search(message, said), said
    assert not (tmp_path / "law.json").exists()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.csv", None, "there is no file"),
        ("run.txt", b"1,2", "neither a recording"),
        ("broken.parquet", b"not a table", "cannot be read as a table"),
        ("semicolons.csv", b"pre_contact_velocity;post_contact_velocity\n-1;1\n", "has 'pre_contact_velocity;post_"),
        ("broken.csv", b"a,b\n1,2,3,4\n1,2,3\n", "has no column|cannot be read"),
        ("broken.rrd", b"not a recording", "is not a recording"),
        ("empty.csv", b"", "cannot be read as a table"),
        ("binary.csv", bytes(range(256)), "cannot be read as a table|has no column"),
    ],
)
def test_files_that_are_no_tables(tmp_path, monkeypatch, capsys, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, "--out", tmp_path / "law.json")
    assert code == 2
    assert said.startswith("impactlaw: ")
    assert said.count("\n") == 1
    assert pytest.importorskip("re").search(message, said), said


def test_what_is_no_file():
    with pytest.raises(MeasurementError, match="read from a file, got None"):
        read_collisions(None)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--family", "newtons"), "unknown family"),
        (("--folds", "1"), "data.csv: 12 collisions cannot be split into 1 folds: 2 to 12"),
        (("--folds", "13"), "data.csv: 12 collisions cannot be split into 13 folds: 2 to 12"),
        (("--contacts",), "contacts is empty: there is nothing to fit"),
        (("--contacts", "a/c"), "no collision has exactly the contacts a/c"),
        (("--family", "routh"), "needs tangential directions"),
    ],
)
def test_options_that_do_not_fit(tmp_path, monkeypatch, capsys, words, message):
    path = table(tmp_path / "data.csv", chain_rows())
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, "--out", tmp_path / "law.json", *words)
    assert code == 2
    assert message in said
    assert said.count("\n") == 1
