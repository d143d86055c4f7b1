"""The quick form of the stability study: every case has the verdicts that it states."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
stability, cases, verdicts, worker_module = map(
    importlib.import_module, ("stability", "stability_cases", "stability_verdicts", "stability_worker")
)
RIGHT, REFUSED = verdicts.RIGHT, verdicts.REFUSED


@pytest.fixture(scope="module")
def worker():
    with worker_module.Worker() as running:
        yield running


@pytest.mark.parametrize("name", cases.CASES)
def test_every_verdict_is_the_stated_one(name, worker):
    rows = stability.run_case(cases.CASES[name], True, worker)
    table = pd.DataFrame(rows)
    assert table.as_expected.all(), stability.format_table(table)


def test_every_law_case_is_run_with_every_solver():
    from impactlaw.solvers import SOLVERS

    for case in cases.CASES.values():
        if case.kind == "law":
            assert set(case.solvers) == {*SOLVERS, "auto"}


def test_every_refusal_has_its_reason():
    for case in cases.CASES.values():
        assert all(expected.reason and expected.error for expected in case.expected)


def test_a_refusal_for_another_reason_is_not_the_expected_one():
    expected = verdicts.Expected(REFUSED, "why", "SceneError: this")
    assert expected.fits(REFUSED, "SceneError: this it is")
    assert not expected.fits(REFUSED, "SceneError: that")
    assert not expected.fits(RIGHT, "")
    either = verdicts.Expected(verdicts.EITHER, "why", "SolverError")
    assert [either.fits(*found) for found in ((RIGHT, ""), (REFUSED, "SolverError: x"), ("WRONG", ""))] == [1, 1, 0]


def three_balls():
    M, J = np.eye(3), np.diff(np.eye(3), axis=0)
    return M, J, np.array([1.0, 0.0, 0.0]), np.array([-1.0, 2.0, 2.0]) / 3.0, np.array([4.0, 2.0]) / 3.0


def test_the_certificate_accepts_moreaus_answer_and_no_other():
    M, J, v, after, impulse = three_balls()
    good = verdicts.certify(M, J, v, after, impulse, -J @ v)
    assert good.residual < 1e-15
    assert abs(good.balance) < 1e-15
    assert abs(good.change) < 1e-15
    assert good.penetration == 0.0
    off = np.array([0.0, 1e-6, 0.0])
    assert verdicts.certify(M, J, v, after + off, impulse, -J @ v).residual == pytest.approx(1e-6, rel=0.5)
    assert verdicts.certify(M, J, v, after, impulse + np.array([1e-6, 0.0]), -J @ v).residual > 1e-7
    assert verdicts.certify(M, J, v, v, np.zeros(2), -J @ v).penetration == pytest.approx(1 / np.sqrt(2))


@pytest.mark.parametrize("name", ["residual", "energy", "penetration", "deviation"])
def test_each_measurement_alone_makes_a_result_wrong_or_no_number(name):
    limits = verdicts.Limits()
    assert verdicts.verdict(verdicts.Measurement(), limits)[0] == RIGHT
    found, reason = verdicts.verdict(verdicts.Measurement(**{name: 1e-3}), limits)
    assert found == verdicts.WRONG
    assert name in reason
    assert verdicts.verdict(verdicts.Measurement(**{name: float("nan")}), limits)[0] == verdicts.NAN


def test_a_row_that_hangs_is_a_row_and_the_next_one_runs(worker):
    name = next(name for name in cases.CASES if name.startswith("stack of 50"))
    task = worker_module.Task(name, "moreau 1", "auto", True)
    assert worker.run(task, 0.0).verdict == verdicts.HANGS
    name = "five balls at 1e+0 m/s"
    assert worker.run(worker_module.Task(name, "moreau 1", "auto", True), 60.0).verdict == RIGHT
    assert worker.run(worker_module.Task(name, "moreau 2", "auto", True), 60.0).verdict == verdicts.CRASHES


def test_the_command_writes_every_row_and_fails_where_a_verdict_is_another(tmp_path, capsys, monkeypatch):
    chosen = "two of four gradients are zero"
    study = stability.Stability(quick=True, cases=(chosen,))
    with pytest.raises(SystemExit) as end:
        stability.main(study, tmp_path)
    assert end.value.code == 0
    table = pd.read_csv(tmp_path / "stability.csv", keep_default_na=False)
    case = cases.CASES[chosen]
    assert len(table) == len(case.laws) * len(case.solvers)
    assert set(table.verdict) == {RIGHT, REFUSED}
    assert "refused, as expected" in capsys.readouterr().out
    strict = verdicts.Case(chosen, case.kind, case.measure, case.laws, case.solvers)  # that states no refusal
    monkeypatch.setitem(stability.CASES, chosen, strict)
    with pytest.raises(SystemExit) as end:
        stability.main(study, tmp_path)
    assert end.value.code == 1
    assert "NOT AS EXPECTED: refused instead of right" in capsys.readouterr().out


def test_a_case_that_does_not_exist_is_named():
    with pytest.raises(SystemExit, match="no case matches 'stakc"):
        stability.main(stability.Stability(cases=("stakc*",)))
