"""Files of collisions: recordings and tables, the command line, and what malformed files are told."""

import json
import sys

import mujoco
import numpy as np
import pandas as pd
import pytest
from problems import balls

from impactlaw import Collision, Fremond, Moreau, Newton, Stepper, make_law
from impactlaw.cli import main
from impactlaw.errors import MeasurementError, RestitutionError
from impactlaw.identification import cross_validate, fit, read_collisions
from impactlaw.identification.report import study
from impactlaw.models import load
from impactlaw.recording import Recorder, read_log
from impactlaw.recording import collisions as writer
from impactlaw.recording.layout import COLLISION_COLUMNS


def run_cli(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["impactlaw", *map(str, words)])
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    said = capsys.readouterr()
    return code, said.out, said.err


def row(c: Collision, after, **more):
    """A row of a table of contact velocities."""
    lists = {
        "contacts": list(c.labels),
        "pre_contact_velocity": c.pre_contact_velocity.tolist(),
        "post_contact_velocity": (c.jacobian @ after).tolist(),
        "delassus": c.delassus.tolist(),
    }
    return {name: json.dumps(value) for name, value in (lists | more).items()}


def chain_rows(n=12, law=None, seed=0):
    law, rng, rows = law or Newton([0.3, 0.8]), np.random.default_rng(seed), []
    for _ in range(n):
        c = balls([1.0, 2.0, 1.5], np.sort(rng.normal(size=3))[::-1])
        c = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, labels=("a/b", "b/c"))
        impact = law.resolve(c)
        rows.append(row(c, impact.post_velocity, impulse=impact.impulse.tolist()))
    return rows


def table(path, rows):
    frame = pd.DataFrame(rows)
    if path.suffix == ".parquet":
        frame = frame.map(json.loads)
        frame["delassus"] = [np.ravel(cell).tolist() for cell in frame["delassus"]]
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_of_contact_velocities(tmp_path, suffix):
    found = fit(*read_collisions(table(tmp_path / f"drops{suffix}", chain_rows())), "newton")
    assert found.parameters == pytest.approx({"restitution a/b": 0.3, "restitution b/c": 0.8}, abs=1e-7)


def test_without_a_delassus_matrix_it_follows_from_impulses(tmp_path):
    rows = [{name: cell for name, cell in row.items() if name != "delassus"} for row in chain_rows()]
    collisions, _ = read_collisions(table(tmp_path / "run.csv", rows))
    expected = [[1.5, -0.5], [-0.5, 0.5 + 1 / 1.5]]
    np.testing.assert_allclose(collisions[0].delassus, expected, rtol=0, atol=1e-9)


def test_tables_of_everything(tmp_path):
    c = Collision(np.diag([1.0, 1.0, 0.5]), [[0, 1, 0.2]], [3.0, -1.0, 0.5])
    cells = {
        "mass_matrix": c.mass_matrix.tolist(),
        "jacobian": c.jacobian.tolist(),
        "pre_velocity": c.pre_velocity.tolist(),
        "post_velocity": [1.0, 2.0, 3.0],
        "friction_jacobian": [[1, 0, 0.3]],
        "friction_coefficient": [0.4],
    }
    rows = [{name: json.dumps(value) for name, value in cells.items()}] * 2
    collisions, after = read_collisions(table(tmp_path / "all.csv", rows))
    np.testing.assert_array_equal(collisions[1].mass_matrix, c.mass_matrix)
    np.testing.assert_array_equal(collisions[1].friction.jacobian, [[1, 0, 0.3]])
    assert collisions[1].friction.coefficient.tolist() == [0.4]
    np.testing.assert_array_equal(after[0], [1.0, 2.0, 3.0])


def test_drops_of_a_ball_need_two_columns(tmp_path):
    path = tmp_path / "ball.csv"
    path.write_text("pre_contact_velocity,post_contact_velocity\n-1,0.7\n-2,1.4\n-4,2.8\n")
    assert fit(*read_collisions(path), "moreau").parameters["restitution"] == pytest.approx(0.7, abs=1e-9)


@pytest.mark.parametrize("old", [False, True])
def test_recordings_of_any_version(tmp_path, monkeypatch, old):
    """A law's own recording gives it back; without the column, too, since G is the same in all of these collisions."""
    if old:
        without = {name: kind for name, kind in COLLISION_COLUMNS.items() if name != "delassus"}
        monkeypatch.setattr(writer, "COLLISION_COLUMNS", without)
    model, data = load("bouncing_ball")
    path, stepper = tmp_path / "run.rrd", Stepper(model, Moreau(0.6))
    with Recorder(model, path, law=stepper.law) as recorder:
        for _ in range(130):
            stepper.step(data)
            recorder.step(data, stepper.events)
    cells = read_log(path).collisions["delassus"].tolist()
    assert all(len(cell) == (0 if old else 1) for cell in cells)
    found = fit(*read_collisions(path), "moreau")
    assert found.parameters["restitution"] == pytest.approx(0.6, abs=1e-9)


def test_friction_of_a_recording_comes_back(tmp_path):
    model, data = load("box_drop")
    path, stepper = tmp_path / "run.rrd", Stepper(model, Newton(0.5))
    events = []
    with Recorder(model, path, law=stepper.law) as recorder:
        while len(events) < 3 and data.time < 3:
            stepper.step(data)
            recorder.step(data, stepper.events)
            events += stepper.events
    collisions, after = read_collisions(path)
    for c, v, event in zip(collisions, after, events, strict=True):
        one = event.impact.collision
        np.testing.assert_allclose(c.delassus, one.delassus, rtol=0, atol=1e-9 * np.abs(one.delassus).max())
        np.testing.assert_allclose(c.jacobian @ v, event.impact.post_contact_velocity, rtol=0, atol=1e-9)
        assert (c.friction is None) == (one.friction is None)


def test_mujoco_is_identified_by_the_command_line_alone(tmp_path, monkeypatch, capsys):
    """MuJoCo's contacts with impedance 0.9999, tuned to e = 1: a ball that bounces, and a cradle."""
    out = tmp_path / "run"
    words = ("bouncing_ball", "--restitution", 1, "--timestep", 1e-3, "--laws", "moreau", "--out", out)
    assert run_cli(monkeypatch, capsys, "compare", *words)[0] == 0
    code, said, _ = run_cli(monkeypatch, capsys, "identify", out / "mujoco-tuned.rrd", "--out", tmp_path / "law.json")
    assert code == 0
    assert "best:" in said
    law = json.loads((tmp_path / "law.json").read_text())
    assert law["parameters"]["restitution"] == pytest.approx(1.0, abs=1e-3)
    assert (tmp_path / "law.png").stat().st_size < 60_000
    assert law["rms"] < 2e-3


def test_an_identified_law_drives_a_stepper(tmp_path, monkeypatch, capsys):
    path = table(tmp_path / "chain.csv", chain_rows(30, Fremond([[0.2, 0.5], [0.1, 0.4]])))
    code, said, _ = run_cli(
        monkeypatch, capsys, "identify", path, "--family", "fremond", "--out", tmp_path / "law.json"
    )
    assert code == 0
    assert "fremond" in said
    law = make_law(str(tmp_path / "law.json"))
    np.testing.assert_allclose(
        law.restitution_matrix(Collision(np.eye(2), np.eye(2), [-1, -1], labels=("a/b", "b/c"))),
        [[0.2, 0.5], [0.1, 0.4]],
        atol=1e-9,
    )
    run_cli(monkeypatch, capsys, "identify", path, "--family", "moreau", "--out", tmp_path / "moreau.json")
    model, data = load("bouncing_ball")
    stepper = Stepper(model, make_law(tmp_path / "moreau.json"))
    while not stepper.events:
        stepper.step(data)
    c = stepper.events[0].impact
    e = json.loads((tmp_path / "moreau.json").read_text())["parameters"]["restitution"]
    np.testing.assert_allclose(c.post_contact_velocity, -e * c.collision.pre_contact_velocity, rtol=1e-9)
    mujoco.mj_forward(model, data)


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


# --- malformed files -------------------------------------------------------------------------------------------------


def changed(number=0, **cells):
    """Rows of a chain of which one has other cells; None takes the column away."""
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
    "other columns": ([{"x": 1, "y": 2}], "has no column"),
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
        "too few, or too alike",
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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--family", "newtons"), "unknown family"),
        (("--folds", "1"), "folds must be 2 or more"),
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


def test_the_law_is_json(tmp_path, monkeypatch, capsys):
    path = table(tmp_path / "data.csv", chain_rows())
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, "--out", tmp_path / "law.txt")
    assert (code, "does not end with .json" in said) == (2, True)


def test_the_best_family_is_the_law_that_made_it(tmp_path):
    found = study(table(tmp_path / "data.csv", chain_rows(20)))
    assert found.best.family == "newton"
    assert found.audit.admissible == 1.0
    with pytest.raises(MeasurementError):
        cross_validate(*read_collisions(tmp_path / "data.csv"), "newton", folds=50)
