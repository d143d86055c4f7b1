"""From a problem to a certified answer: no wrong answers, guesses, proofs of infeasibility, projections."""

import sys

import numpy as np
import pytest
from certificates import assert_certified, assert_nearest_in_cone
from problems import balls, box, launched
from scipy.optimize import nnls

from impactlaw import Collision, Fremond, Impact, Moreau, Newton
from impactlaw.errors import SolverError, UnsolvableLawError
from impactlaw.solvers import (
    SOLVERS,
    Problem,
    Solution,
    Status,
    farkas_ray,
    nonnegative_combination,
    solve,
    solve_with_jump,
)
from impactlaw.solvers.certificate import judge_active


def wrong(problem: Problem) -> Solution:
    return Solution(np.full(len(problem.bound), 0.1))


def not_a_number(problem: Problem) -> Solution:
    return Solution(np.full(len(problem.bound), np.nan))


def gives_up(problem: Problem) -> Solution:
    return Solution(np.zeros(len(problem.bound)), Status.STOPPED)


def calls_it_infeasible(problem: Problem) -> Solution:
    return Solution(np.zeros(len(problem.bound)), Status.INFEASIBLE)


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("bad", [not_a_number, gives_up, calls_it_infeasible])
def test_no_wrong_answer_passes(monkeypatch, bad):
    """A solver that fails is refused if it is named, and replaced under "auto"."""
    c = launched(5, 2)
    law = Newton([0.1, 0.2, 0.3, 0.4])
    right = law.resolve(c)
    monkeypatch.setitem(SOLVERS, "dual-active-set", bad)
    with pytest.raises(SolverError, match="'dual-active-set' reached"):
        law.resolve(c, solver="dual-active-set")
    np.testing.assert_allclose(law.resolve(c).post_velocity, right.post_velocity, atol=1e-12)


def test_a_wrong_active_set_is_refused(monkeypatch):
    """The refinement corrects impulses on the contacts that a solver chooses, but not the choice."""
    c = launched(3, 1)
    law = Fremond(np.array([[0.0, 1.0], [1.0, 0.0]]))
    monkeypatch.setitem(SOLVERS, "nnls", lambda problem: Solution(np.array([1.0, 0.0])))
    with pytest.raises(SolverError):
        law.resolve(c, solver="nnls")
    monkeypatch.setitem(SOLVERS, "nnls", wrong)
    np.testing.assert_allclose(law.resolve(c, solver="nnls").post_velocity, [0, 0, 1], atol=1e-12)


def test_the_certificate_is_sharp(monkeypatch):
    """If a contact is left out that remains 1e-6 too slow, the error is 1e-6, whatever the solver claims."""
    c = Collision(np.eye(2), [[1.0, 0.0], [0.6, 0.8]], [-1.0, -1.5e-6 / 1.2])
    monkeypatch.setitem(SOLVERS, "nnls", lambda problem: Solution(np.array([1.5, 0.0])))
    with pytest.raises(SolverError, match=r"'nnls' reached relative residual 1.0e-06 on 2 contacts"):
        Moreau(0.5).resolve(c, solver="nnls")
    assert Moreau(0.5).resolve(c).residual < 1e-15


@pytest.mark.parametrize("solver", [name for name in SOLVERS if name not in ("osqp", "projected-gauss-seidel")])
def test_a_fast_collision_elsewhere_excuses_nothing(solver):
    """Two separate collisions, one of them 1e20 times faster: each is exact."""
    c = Collision(np.eye(2), np.eye(2), [-1e8, -1e-12])
    np.testing.assert_allclose(Moreau(0.5).resolve(c, solver=solver).post_velocity, [0.5e8, 0.5e-12], rtol=1e-12)


def test_a_law_that_knows_a_velocity_is_never_called_unsolvable(monkeypatch):
    """The projection on a cone always exists, so that a proof of the contrary is wrong."""
    monkeypatch.setattr(sys.modules["impactlaw.solvers.solve"], "farkas_ray", lambda problem: problem.norms)
    monkeypatch.setattr(sys.modules["impactlaw.solvers.solve"], "judge_active", lambda problem, active: None)
    for name in SOLVERS:
        monkeypatch.setitem(SOLVERS, name, calls_it_infeasible)
    with pytest.raises(SolverError, match="'auto' reached relative residual"):
        Moreau(0.5).resolve(box())
    with pytest.raises(UnsolvableLawError):
        Newton([0.1, 0.2, 0.3, 0.4]).resolve(box())


# --- the parts -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [2, 3, 4, 8, 16, 40])
@pytest.mark.parametrize("knows_velocity", [False, True])
def test_independent_contacts_are_solved_as_by_nnls(h, knows_velocity):
    """The active set is that of NNLS; bounds have both signs, so that contacts leave and enter."""
    for seed in range(40):
        rng = np.random.default_rng([52, h, seed])
        Y, d = rng.normal(size=(h, 2 * h)), rng.normal(size=2 * h)
        impulse = solve(Problem(Y, Y @ d, d if knows_velocity else None), ("",) * h)
        reference, _ = nnls(Y.T, d, maxiter=30 * h)
        np.testing.assert_array_equal(impulse > 0, reference > 0)
        np.testing.assert_allclose(impulse, reference, rtol=0, atol=1e-11)


def test_nothing_is_concluded_from_contacts_that_depend_on_each_other():
    Y = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    assert judge_active(Problem(Y, np.array([1.0, 1.0, 3.0])), np.ones(3, dtype=bool)) is None
    nearly = Problem(np.array([[1.0, 0.0], [1.0, 1e-9]]), np.array([1.0, 1.0]))
    assert judge_active(nearly, np.ones(2, dtype=bool)) is None


def test_solve_needs_no_law():
    Y, d = np.array([[1.0, 0.0], [0.6, 0.8]]), np.array([2.0, 1.0])
    labels = ("a", "b")
    np.testing.assert_allclose(solve(Problem(Y, Y @ d, d), labels) @ Y, d, atol=1e-14)
    np.testing.assert_allclose(solve(Problem(Y, Y @ d), labels) @ Y, d, atol=1e-14)
    answer = solve_with_jump(Problem(Y, Y @ d), labels)
    np.testing.assert_allclose(answer.jump, d, atol=1e-14)
    np.testing.assert_allclose(answer.slack, [0.0, 0.0], atol=1e-14)
    assert answer.residual < 1e-14


def test_rows_of_zeros_are_left_out():
    Y = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0]])
    answer = solve_with_jump(Problem(Y, np.array([-1.0, 25.0, 0.0])), ("a", "b", "c"))
    np.testing.assert_allclose(answer.impulse, [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(answer.slack, [1.0, 0.0, 0.0], atol=1e-15)
    with pytest.raises(UnsolvableLawError, match="contacts c ask"):
        solve(Problem(Y, np.array([-1.0, 25.0, 1.0])), ("a", "b", "c"))


def test_farkas_ray_names_only_what_conflicts():
    Y = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0], [0.5, 0.1]])
    ray = farkas_ray(Problem(Y, np.array([1.0, 1.0, -1.0, 0.1])))
    assert ray is not None
    np.testing.assert_allclose(ray, [1.0, 1.0, 1.0, 0.0], atol=1e-14)
    assert farkas_ray(Problem(Y, np.array([1.0, 1.0, -2.0, 0.1]))) is None
    assert farkas_ray(Problem(Y, -np.ones(4))) is None


def test_a_far_solution_is_a_solution():
    """Nearly opposite gradients: an apparent conflict of 2e-8 is solved by a jump 200 times as large."""
    Y = np.array([[1.0, 0.0], [-1.0, 1e-10]])
    answer = solve_with_jump(Problem(Y, np.array([1.0, -1.0 + 2e-8])), ("a", "b"))
    np.testing.assert_allclose(answer.jump, [1.0, 200.0], rtol=1e-6)
    with pytest.raises(UnsolvableLawError):
        solve(Problem(Y, np.array([1.0, -0.5])), ("a", "b"))


def test_small_conflicts_are_conflicts():
    """A conflict of 1e-9 of the velocities is found; 1e-14 is rounding."""
    Y = np.array([[1.0, 0.0], [-1.0, 0.0]])
    with pytest.raises(UnsolvableLawError):
        solve(Problem(Y, np.array([1.0, -1.0 + 1e-9])), ("a", "b"))
    impulse = solve(Problem(Y, np.array([1.0, -1.0 + 1e-14])), ("a", "b"))
    np.testing.assert_allclose(impulse @ Y, [1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(40))
def test_nonnegative_combination_is_the_projection(seed):
    """The combination is the nearest point of the cone: the rest is orthogonal to it and points outwards."""
    rng = np.random.default_rng([43, seed])
    Y, point = rng.normal(size=(6, 4)), rng.normal(size=4)
    assert_nearest_in_cone(Y, point, nonnegative_combination(Y, point))


def test_nonnegative_combination_of_nothing():
    assert nonnegative_combination(np.zeros((0, 3)), np.ones(3)).shape == (0,)
    assert nonnegative_combination(np.zeros((2, 3)), np.ones(3)).tolist() == [0.0, 0.0]
    assert nonnegative_combination(np.eye(3), np.zeros(3)).tolist() == [0.0, 0.0, 0.0]


def test_long_chain_of_very_different_masses():
    """256 balls with masses over twelve orders of magnitude."""
    rng = np.random.default_rng(44)
    c = balls(10.0 ** rng.uniform(-6, 6, 257), rng.normal(size=257))
    for law in (Moreau(0.9), Newton(rng.uniform(size=256).tolist()), Fremond.reversal()):
        assert_certified(law.resolve(c), law)


def test_impulse_of_an_impact_is_not_shared_with_another():
    c = launched(3, 1)
    first, second = Moreau(0.5).resolve(c), Moreau(0.5).resolve(c)
    assert not np.shares_memory(first.impulse, second.impulse)
    assert isinstance(first, Impact)


@pytest.mark.parametrize(
    ("gradients", "velocity", "E", "solver"),
    [
        ([[0.0], [1.0], [-1.0]], [1.0], np.diag([0.0, -2.0, 2.0]), "auto"),
        ([[1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], [-1.0, 1.0], np.diag([0.0, -2.0, 2.0]), "dual-active-set"),
    ],
)
def test_a_proof_has_an_entry_for_each_contact(gradients, velocity, E, solver):
    with pytest.raises(UnsolvableLawError) as refused:
        Fremond(E).resolve(Collision(np.eye(len(velocity)), gradients, velocity), solver=solver)
    assert refused.value.contacts == ("1", "2")
    assert refused.value.ray.shape == (3,)
    assert refused.value.ray[0] == 0.0


def test_groups_of_very_different_speeds_are_not_called_unsolvable():
    """A law with one coefficient always has a solution, whatever the solver."""
    rng = np.random.default_rng(0)
    for _ in range(40):
        Q, a = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(0, 2 * np.pi, size=2)
        Y = np.column_stack([np.cos(a), np.sin(a), 0 * a])
        Y = np.vstack([Y, -(0.7 * Y[0] + 1.3 * Y[1])]) @ Q.T
        J = np.block([[Y, np.zeros((3, 3))], [np.zeros((3, 3)), Y]])
        v = Q @ np.array([*1e-2 * rng.normal(size=2), 1e3])
        collision = Collision(np.eye(6), J, np.concatenate([v, -v]))
        assert Moreau(0.5).resolve(collision, solver="nnls").residual < 1e-9
