"""Files of collisions: recordings and tables, and the command line."""

import json

import mujoco
import numpy as np
import pandas as pd
import pytest
from identification.tables import chain_rows, run_cli, table
from matplotlib.axes import Axes

from impactlaw import Collision, Fremond, Moreau, Newton, Stepper, make_law
from impactlaw.errors import MeasurementError
from impactlaw.identification import cross_validate, fit, read_collisions
from impactlaw.identification.report import study
from impactlaw.models import load
from impactlaw.recording import Recorder, read_log
from impactlaw.recording import collisions as writer
from impactlaw.recording.layout import COLLISION_COLUMNS


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_of_contact_velocities(tmp_path, suffix):
    found = fit(*read_collisions(table(tmp_path / f"drops{suffix}", chain_rows())), "newton")
    assert found.parameters == pytest.approx({"restitution a/b": 0.3, "restitution b/c": 0.8}, abs=1e-7)


def test_without_a_delassus_matrix_it_follows_from_impulses(tmp_path):
    rows = [{name: cell for name, cell in row.items() if name != "delassus"} for row in chain_rows()]
    collisions, _ = read_collisions(table(tmp_path / "run.csv", rows))
    expected = [[1.5, -0.5], [-0.5, 0.5 + 1 / 1.5]]
    np.testing.assert_allclose(collisions[0].delassus, expected, rtol=0, atol=1e-9)


def test_only_collisions_without_a_delassus_matrix_are_asked_for_impulses(tmp_path):
    """Row 0 has a matrix and no impulse; rows 2 to 4, an impulse and no matrix; a single contact needs neither."""
    rows = chain_rows()
    del rows[0]["impulse"]
    for one in rows[2:5]:
        del one["delassus"]
    rows += [{"contacts": '["x/y"]', "pre_contact_velocity": "-1", "post_contact_velocity": "0.5"}]
    collisions, _ = read_collisions(table(tmp_path / "some.csv", rows))
    for c in collisions[:-1]:
        np.testing.assert_allclose(c.delassus, [[1.5, -0.5], [-0.5, 0.5 + 1 / 1.5]], rtol=0, atol=1e-9)
    assert collisions[-1].delassus.tolist() == [[1.0]]


def test_one_set_of_contacts_can_be_read_where_another_tells_no_delassus_matrix(tmp_path, monkeypatch, capsys):
    """A box lands on 24 contacts with friction, more rows than a recording has G of; a ball beside it bounces."""
    corners = [f"<geom name='c{i}' type='box' size='.1 .1 .1' pos='{0.5 * i} 0 0'/>" for i in range(6)]
    bodies = [f"<body pos='0 0 .15'><freejoint/>{''.join(corners)}</body>"]
    bodies += ["<body pos='0 2 .6'><freejoint/><geom name='ball' size='.1'/></body>"]
    scene = f"<worldbody><geom name='f' type='plane' size='9 9 1'/>{''.join(bodies)}</worldbody>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><option integrator='RK4'/>{scene}</mujoco>")
    data, path = mujoco.MjData(model), tmp_path / "run.rrd"
    stepper = Stepper(model, Moreau(0.4), scheme="time-stepping")
    with Recorder(model, path, law=stepper.law) as recorder:
        for _ in range(400):
            stepper.step(data)
            recorder.step(data, stepper.events)
    with pytest.raises(MeasurementError, match=r"f/c0.* choose other collisions by contacts"):
        read_collisions(path)
    collisions, after = read_collisions(path, contacts="ball/f")
    assert len(collisions) == len(after) >= 3
    assert fit(collisions, after, "moreau").parameters["restitution"] == pytest.approx(0.4, abs=1e-9)
    words = ("identify", path, "--family", "moreau", "--out", tmp_path / "law.json", "--contacts")
    assert run_cli(monkeypatch, capsys, *words, "f/ball")[0] == 0
    code, _, said = run_cli(monkeypatch, capsys, *words, "ball")
    assert (code, said.count("\n")) == (2, 1)
    assert "no collision has exactly the contacts ball; there are: " in said


def test_chosen_rows_keep_their_numbers_in_messages(tmp_path):
    rows = [*chain_rows(3), *chain_rows(3)]
    for one in rows[1::2]:
        one["contacts"] = '["c/d", "d/e"]'
    rows[3]["post_contact_velocity"] = "[1.0]"
    path = table(tmp_path / "two.csv", rows)
    assert len(read_collisions(path, contacts=("b/c", "b/a")).collisions) == 3
    with pytest.raises(MeasurementError, match="row 3: 2 contact velocities before, 1 after"):
        read_collisions(path, contacts=("c/d", "d/e"))


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
    """A law is found in its own recording, also without the column of G, which is constant in this recording."""
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


def test_the_law_is_json(tmp_path, monkeypatch, capsys):
    path = table(tmp_path / "data.csv", chain_rows())
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, "--out", tmp_path / "law.txt")
    assert (code, "does not end with .json" in said) == (2, True)


def test_the_best_family_is_the_law_that_made_it(tmp_path):
    found = study(table(tmp_path / "data.csv", chain_rows(10)))
    assert found.best.family == "newton"
    assert found.audit.admissible == 1.0
    with pytest.raises(MeasurementError):
        cross_validate(*read_collisions(tmp_path / "data.csv"), "newton", folds=50)


@pytest.mark.parametrize(("collisions", "words", "folds"), [(12, (), 5), (12, ("--folds", 12), 12), (3, (), 3)])
def test_the_report_tells_the_number_of_folds(collisions, words, folds, tmp_path, monkeypatch, capsys):
    path = table(tmp_path / "data.csv", chain_rows(collisions))
    words = ("--family", "newton", "--out", tmp_path / "law.json", *words)
    code, said, _ = run_cli(monkeypatch, capsys, "identify", path, *words)
    first = f"{collisions} collisions, 100% admissible within 0.1 |v-|; {folds} folds"
    assert (code, said.splitlines()[0]) == (0, first)


def test_folds_are_those_of_the_contacts_that_are_chosen(tmp_path):
    other = {"contacts": '["d/e", "e/f"]'}
    path = table(tmp_path / "data.csv", chain_rows(3) + [one | other for one in chain_rows(9, seed=1)])
    assert study(path, family="newton", contacts=("a/b", "b/c")).folds == 3
    with pytest.raises(MeasurementError, match="3 collisions cannot be split into 4 folds"):
        study(path, family="newton", contacts=("a/b", "b/c"), folds=4)


def drops(bounce, n, contacts, wrong=1.0):
    speeds = np.random.default_rng(n).uniform(1.0, 2.0, n)
    names = ("contacts", "pre_contact_velocity", "post_contact_velocity")
    return [dict(zip(names, (contacts, -v, wrong * bounce * v), strict=True)) for v in speeds]


def test_counts_audit_and_picture_are_those_of_the_contacts_that_are_chosen(tmp_path, monkeypatch, capsys):
    """The collisions of the other contacts, most of the file, gain energy."""
    path = table(tmp_path / "data.csv", drops(0.8, 40, "a/floor", wrong=5.0) + drops(0.2, 10, "b/floor"))
    words = ("--family", "newton", "--out", tmp_path / "law.json")
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, *words)
    assert (code, "only 20% of 50 collisions" in said) == (2, True)
    drawn = []
    monkeypatch.setattr(Axes, "plot", lambda self, x, *_, **__: drawn.append(len(x)))
    code, said, _ = run_cli(monkeypatch, capsys, "identify", path, *words, "--contacts", "b/floor")
    assert (code, said.splitlines()[0]) == (0, "10 collisions, 100% admissible within 0.1 |v-|; 5 folds")
    assert "restitution 0.2000" in said
    assert drawn == [1] * 10 + [2]  # one point per collision, and the diagonal


def test_one_collision_of_the_contacts_that_are_chosen_is_too_few(tmp_path):
    path = table(tmp_path / "data.csv", drops(0.8, 4, "a/floor") + drops(0.2, 1, "b/floor"))
    with pytest.raises(MeasurementError, match="has 1 collision of the contacts b/floor: a law is identified from 2"):
        study(path, contacts=("b/floor",))


def test_law_and_picture_are_both_written_or_none_of_them(tmp_path, monkeypatch, capsys):
    path = table(tmp_path / "data.csv", drops(0.8, 10, "a/floor"))
    (tmp_path / "out" / "law.png").mkdir(parents=True)
    code, _, said = run_cli(monkeypatch, capsys, "identify", path, "--out", tmp_path / "out" / "law.json")
    assert (code, said.count("\n")) == (2, 1)
    assert "there is a folder of that name" in said
    assert [one.name for one in (tmp_path / "out").iterdir()] == ["law.png"]


def test_an_empty_cell_of_a_recording_is_empty_in_csv_too(tmp_path):
    """As for a matrix of too many contacts to be recorded, which follows from impulses."""
    rows = [row | {"delassus": "[]"} for row in chain_rows()]
    expected = [[1.5, -0.5], [-0.5, 0.5 + 1 / 1.5]]
    collisions, _ = read_collisions(table(tmp_path / "data.csv", rows))
    np.testing.assert_allclose(collisions[0].delassus, expected, rtol=0, atol=1e-9)


def test_a_number_alone_is_a_list_or_a_matrix_of_one_entry(tmp_path):
    cells = {"mass_matrix": 2.0, "jacobian": 1.0, "pre_velocity": -1.0, "post_velocity": 0.5}
    pd.DataFrame([cells]).to_csv(tmp_path / "numbers.csv", index=False)
    (collision,), (after,) = read_collisions(tmp_path / "numbers.csv")
    assert (collision.mass_matrix.tolist(), collision.jacobian.tolist()) == ([[2.0]], [[1.0]])
    assert (collision.pre_velocity.tolist(), after.tolist()) == ([-1.0], [0.5])
