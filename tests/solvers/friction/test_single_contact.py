"""A single contact with friction: closed-form answers agree with Newton's method."""

import numpy as np
import pytest

from impactlaw.solvers.friction.problem import ConeProblem
from impactlaw.solvers.friction.single_contact import single
from impactlaw.solvers.friction.solve import THOROUGH, compiled_answer, solve_cones
from impactlaw.solvers.problem import Status


def alone(rng, m, friction):
    """Return a closing contact of m rows, with coefficients of friction up to a given number."""
    A = rng.normal(size=(m, 6))
    A[1:] *= friction * rng.uniform(0.1, 1.0)
    b = rng.normal(size=m) * 10.0 ** rng.uniform(-3, 3)
    b[0] = -abs(b[0])
    return ConeProblem(A, b, np.array([m]))


@pytest.mark.parametrize("friction", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("m", [1, 2, 3])
def test_contact_alone_is_solved_without_a_newton_step(m, friction):
    rng, kinds = np.random.default_rng(m), set()
    for _ in range(100):
        problem = alone(rng, m, friction)
        x = single(problem, None)
        if x is None:
            continue
        answer = solve_cones(problem)
        assert answer.status is Status.SOLVED
        assert answer.iterations == 0
        assert answer.residual <= 1e-13 * problem.scale
        found, _ = compiled_answer(problem, None, THOROUGH)
        if problem.residual(found, problem.velocity(found)) <= 1e-12 * problem.scale:
            np.testing.assert_allclose(x, found, rtol=0, atol=1e-9 * np.abs(x).max())
            kinds.add("slides" if np.linalg.norm(x[0, 1:]) > 0.999999 * x[0, 0] else "sticks")
    assert kinds == ({"sticks"} if m == 1 else {"slides"} if friction == 0.1 else {"slides", "sticks"})


def test_guess_of_the_direction_does_not_matter():
    rng = np.random.default_rng(0)
    for _ in range(50):
        problem = alone(rng, 3, 0.2)
        x, again = single(problem, None), single(problem, np.array([1.0, *rng.normal(size=2)]))
        assert x is not None
        np.testing.assert_allclose(again, x, rtol=0, atol=1e-13 * np.abs(x).max())


@pytest.mark.parametrize(
    ("A", "b"),
    [
        ([[1.0, 0.0], [-2.0, 0.1]], [-1.0, 1.0]),  # friction presses the contact together
        ([[0.0, 0.0], [1.0, 0.0]], [-1.0, 1.0]),  # no motion opens the contact
        ([[1.0, 0.0, 0.0, 0.0], *(0.3 * np.eye(4)[1:])], [-1.0, 1.0, 1.0, 1.0]),  # torsion as well as sliding
    ],
)
def test_what_has_no_closed_form_is_left_to_other_solvers(A, b):
    assert single(ConeProblem(np.array(A), np.array(b), np.array([len(b)])), None) is None


def test_contact_that_separates_gets_no_impulse():
    problem = ConeProblem(np.eye(3), np.array([0.5, 1.0, 0.0]), np.array([3]))
    x = single(problem, None)
    assert x is not None
    assert not x.any()


@pytest.mark.parametrize("sizes", [[3, 3], [1, 3, 2]])
@pytest.mark.parametrize("speed", [0.0, 1e3])
def test_the_same_contacts_with_another_offset_are_the_problem_made_anew(sizes, speed):
    rng, n = np.random.default_rng(0), sum(sizes)
    A, (b, other) = rng.normal(size=(n, 8)), rng.normal(size=(2, n))
    made, anew = ConeProblem(A, b, np.array(sizes)), ConeProblem(A, 100 * other, np.array(sizes), speed=speed)
    again = made.starting(100 * other, speed)
    np.testing.assert_array_equal(again.start, anew.start)
    assert again.scale == anew.scale != made.scale
