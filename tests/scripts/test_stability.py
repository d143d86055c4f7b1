"""The quick form of the stability study: every case has its expected verdicts."""

from contextlib import nullcontext

import numpy as np
import pandas as pd
import pytest

from scripts.apart import Worker
from scripts.stability import __main__ as stability
from scripts.stability import cases, certificate, verdicts
from scripts.stability import worker as worker_module

RIGHT, REFUSED = verdicts.RIGHT, verdicts.REFUSED


@pytest.fixture(scope="module")
def worker():
    with Worker(worker_module.prepare) as running:
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
    good = certificate.certify(M, J, v, after, impulse, -J @ v)
    assert good.residual < 1e-15
    assert abs(good.balance) < 1e-15
    assert abs(good.change) < 1e-15
    assert good.penetration == 0.0
    off = np.array([0.0, 1e-6, 0.0])
    assert certificate.certify(M, J, v, after + off, impulse, -J @ v).residual == pytest.approx(1e-6, rel=0.5)
    assert certificate.certify(M, J, v, after, impulse + np.array([1e-6, 0.0]), -J @ v).residual > 1e-7
    assert certificate.certify(M, J, v, v, np.zeros(2), -J @ v).penetration == pytest.approx(1 / np.sqrt(2))


def geared():
    """A ball of 3 kg hits a slide of 1 kg that a gear of -1.5 couples to one of 2 kg; the gear already slips."""
    M, J = np.diag([1.0, 2.0, 3.0]), np.array([[1.0, 0.0, -1.0]])
    gear = np.array([[1.5, 1.0, 0.0], [3.0, 2.0, 0.0]])
    v = np.array([0.25, 0.5, 1.0])
    effective = 1.0 + 1.5**2 * 2.0
    impulse = 1.5 * 0.75 * 3.0 * effective / (3.0 + effective)
    return M, J, v, v + impulse * np.array([1.0 / effective, -1.5 / effective, -1.0 / 3.0]), np.array([impulse]), gear


def test_the_certificate_knows_bilateral_constraints():
    M, J, v, after, impulse, gear = geared()
    wanted = -0.5 * J @ v
    good = certificate.certify(M, J, v, after, impulse, wanted, bilateral=gear)
    assert max(good.residual, good.balance, good.penetration) < 1e-15
    work = impulse[0] * J[0] @ (v + after) / 2
    assert good.change == pytest.approx(work / _largest_energy(M, v, after, gear))
    assert certificate.certify(M, J, v, after, impulse, wanted).residual > 0.1
    assert certificate.certify(M, J, v, after, 1.001 * impulse, wanted, bilateral=gear).residual > 1e-4
    along = np.array([0.0, 1e-6, 0.0])  # the gear gives way
    assert certificate.certify(M, J, v, after + along, impulse, wanted, bilateral=gear).residual > 5e-7
    free = np.array([1e-6, -1.5e-6, 0.0])
    assert certificate.certify(M, J, v, after + free, impulse, wanted, bilateral=gear).residual > 5e-7


def _largest_energy(M, before, after, gear):
    """Return the larger kinetic energy, before or after, of the motion that the constraints leave free."""
    Y = gear[:1] / np.sqrt(np.diag(M))
    y = Y[0] / np.linalg.norm(Y)
    z = [np.sqrt(np.diag(M)) * v for v in (before, after)]
    return max(0.5 * float(w @ w - (y @ w) ** 2) for w in z)


def thrown_ball(mu):
    """A ball of 1 kg and radius 1 lands with (1, -2) m/s and no spin: it slides if mu is small, otherwise it rolls."""
    M, v, radius = np.diag([1.0, 1.0, 0.4]), np.array([1.0, -2.0, 0.0]), 1.0
    J, T = np.array([[0.0, 1.0, 0.0]]), np.array([[1.0, 0.0, radius]])
    pressing = 1.5 * 2.0
    along = -min(mu * pressing, 1.0 / 3.5)
    after = v + np.array([along, pressing, radius * along / 0.4])
    rows = certificate.Sliding(T, np.zeros(1, int), np.array([mu]), np.array([along]), np.zeros(1), np.zeros(1))
    return (M, J, v, after, np.array([pressing]), -0.5 * J @ v), rows


@pytest.mark.parametrize("mu", [0.05, 0.5])
def test_the_certificate_knows_friction(mu):
    numbers, sliding = thrown_ball(mu)
    good = certificate.certify(*numbers, sliding=sliding)
    assert max(good.residual, good.balance, good.penetration) < 1e-15
    assert good.change < 0
    weaker = 0.999 * sliding.impulse  # momentum is conserved: only Coulomb's law is violated
    M, J, v, after, impulse, wanted = numbers
    after = after + np.linalg.solve(M, sliding.jacobian.T @ (weaker - sliding.impulse))
    found = certificate.certify(M, J, v, after, impulse, wanted, sliding=sliding._replace(impulse=weaker))
    assert found.residual > 1e-5
    narrower = sliding._replace(coefficient=0.9 * sliding.coefficient)  # does not matter if the ball rolls
    assert (certificate.certify(*numbers, sliding=narrower).residual > 1e-3) == (mu < 0.1)
    belt = sliding._replace(before=np.full(1, -1.0), after=np.full(1, -1.0))  # no slip relative to the belt
    assert certificate.certify(*numbers, sliding=belt).residual > 1e-2


def test_the_certificate_counts_what_moving_surfaces_give():
    """A table rises at 2 m/s below a ball at rest, e = 0.5: v+ = 3, its impulse is 3, its work 3 x 2."""
    one, w = np.ones((1, 1)), np.full(1, -2.0)
    numbers = one, one, np.zeros(1), np.full(1, 3.0), np.full(1, 3.0), np.full(1, 1.0)
    good = certificate.certify(*numbers, surfaces=(w, w))
    assert max(good.residual, good.balance, good.penetration) < 1e-15
    assert good.change == pytest.approx((4.5 - 6.0) / 4.5)
    assert certificate.certify(*numbers).residual > 0.1


@pytest.mark.parametrize("name", ["residual", "energy", "penetration", "deviation"])
def test_each_measurement_alone_makes_a_result_wrong_or_no_number(name):
    limits = verdicts.LIMITS
    assert verdicts.verdict(verdicts.Measurement(), limits)[0] == RIGHT
    found, reason = verdicts.verdict(verdicts.Measurement(**{name: 1e-3}), limits)
    assert found == verdicts.WRONG
    assert name in reason
    assert verdicts.verdict(verdicts.Measurement(**{name: float("nan")}), limits)[0] == verdicts.NAN


def test_a_row_that_hangs_is_a_row_and_the_next_one_runs(worker):
    name = next(name for name in cases.CASES if name.startswith("stack of 50"))
    assert worker_module.judged(worker, name, "moreau 1", "auto", True, budget=0.0)[0] == verdicts.HANGS
    name = "five balls at 1e+0 m/s"
    assert worker_module.judged(worker, name, "moreau 1", "auto", True, budget=60.0)[0] == RIGHT
    assert worker_module.judged(worker, name, "moreau two", "auto", True, budget=60.0)[0] == verdicts.CRASHES


def test_the_command_writes_every_row_and_fails_where_a_verdict_is_another(worker, tmp_path, capsys, monkeypatch):
    chosen = "two of four gradients are zero"
    study = stability.Stability(quick=True, cases=(chosen,), out=tmp_path)
    with pytest.raises(SystemExit) as end:
        stability.main(study)
    assert end.value.code == 0
    table = pd.read_csv(tmp_path / "stability.csv", keep_default_na=False)
    case = cases.CASES[chosen]
    assert len(table) == len(case.laws) * len(case.solvers)
    assert set(table.verdict) == {RIGHT, REFUSED}
    assert "refused, as expected" in capsys.readouterr().out
    strict = verdicts.Case(chosen, case.kind, case.measure, case.laws, case.solvers)  # without expected refusals
    monkeypatch.setitem(stability.CASES, chosen, strict)
    monkeypatch.setattr(stability, "Worker", lambda prepare: nullcontext(worker))  # another one would start anew
    with pytest.raises(SystemExit) as end:
        stability.main(study)
    assert end.value.code == 1
    assert "NOT AS EXPECTED: refused instead of right" in capsys.readouterr().out


def test_a_case_that_does_not_exist_is_named():
    with pytest.raises(SystemExit, match="no case matches 'stakc"):
        stability.main(stability.Stability(cases=("stakc*",)))
