"""The impact laws: exact answers, all laws on all problems, relations between laws."""

import numpy as np
import pytest
from certificates import assert_certified, exact_velocity, is_ray, least_impulse, wanted
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import LAWS, PROBLEMS, SWAPPED, box, energy, launched, rod
from scipy.optimize import linprog, nnls

from impactlaw import (
    Collision,
    Coulomb,
    Fremond,
    Friction,
    ImpactLawError,
    LinearMap,
    MaximalDissipation,
    Moreau,
    Newton,
)
from impactlaw.errors import UnknownNameError, UnsolvableLawError
from impactlaw.laws.base import aim, jump_problem

EXACT = {"rtol": 0, "atol": 1e-12}


# --- exact answers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "velocity", "impulse", "topology", "ratio"),
    [
        (MaximalDissipation(), (1 / 3, 1 / 3, 1 / 3), (2 / 3, 1 / 3), (2 / 3, 1 / 3), 1 / 3),
        (Moreau(1.0), (-1 / 3, 2 / 3, 2 / 3), (4 / 3, 2 / 3), (2 / 3, 1 / 3), 1.0),
        (Fremond(SWAPPED), (0, 0, 1), (1, 1), (1 / 2, 1 / 2), 1.0),
        (
            Fremond(0.25 * np.eye(2) + 0.75 * SWAPPED),
            (-1 / 12, 1 / 6, 11 / 12),
            (13 / 12, 11 / 12),
            (13 / 24, 11 / 24),
            0.875,
        ),
    ],
    ids=["E = 0", "E = 1", "swapped", "mixed"],
)
def test_three_balls(law, velocity, impulse, topology, ratio):
    impact = law.resolve(launched(3, 1))
    np.testing.assert_allclose(impact.post_velocity, velocity, **EXACT)
    np.testing.assert_allclose(impact.impulse, impulse, **EXACT)
    np.testing.assert_allclose(impact.topology, topology, **EXACT)
    assert energy(impact.collision, impact.post_velocity) / 0.5 == pytest.approx(ratio, abs=1e-12)
    assert impact.energy_change == pytest.approx(0.5 * (ratio - 1), abs=1e-12)


@pytest.mark.parametrize(("n", "k"), [(n, k) for n in range(2, 13) for k in range(1, n)])
def test_cradle(n, k):
    c = launched(n, k)
    reversal = Fremond.reversal().resolve(c)
    np.testing.assert_allclose(reversal.post_velocity, c.pre_velocity[::-1], **EXACT)
    np.testing.assert_allclose(
        reversal.impulse, np.minimum(np.arange(1, n), [min(k, n - k, n - i) for i in range(1, n)]), **EXACT
    )
    assert reversal.energy_change == pytest.approx(0.0, abs=1e-12)
    for e in (0.0, 0.4, 1.0):
        expected = (1 + e) * k / n - e * c.pre_velocity
        np.testing.assert_allclose(Moreau(e).resolve(c).post_velocity, expected, **EXACT)


def test_rod_on_two_supports():
    impact = Newton([1.0, 0.0]).resolve(rod())
    np.testing.assert_allclose(impact.impulse, (5 / 6, 2 / 3), **EXACT)
    np.testing.assert_allclose(impact.post_contact_velocity, (1, 0), **EXACT)
    assert impact.energy_change / impact.collision.kinetic_energy == pytest.approx(-2 / 3, abs=1e-12)
    assert not impact.has_distant_effect


@pytest.mark.parametrize(("side", "e"), [(2, 0.0), (2, 0.5), (3, 0.5), (8, 1.0)])
def test_flat_box_has_equal_impulses(side, e):
    impact = Moreau(e).resolve(box(side))
    np.testing.assert_allclose(impact.impulse, np.full(side**2, 2.0 * (1 + e) / side**2), **EXACT)
    np.testing.assert_allclose(impact.post_velocity, [0.3, 0, e, 0, 0, 0], **EXACT)


# --- every law on every problem --------------------------------------------------------------------------------------


UNSOLVABLE = {
    ("newton per contact", "ball between two walls"): ("0", "1"),
    ("newton per contact", "rank deficient"): ("0", "3", "6", "7"),
    ("fremond full", "ball between two walls"): ("0", "1"),
    ("fremond full", "rank deficient"): ("0", "1", "5", "7"),
}
DIAGONAL = ["maximal dissipation", "moreau 0", "moreau 0.5", "moreau 1", "newton scalar", "newton per contact"]
CLOSING = [name for name, make in PROBLEMS.items() if (make().pre_contact_velocity <= 0).all()]


def solvable(law_names, problem_names):
    pairs = [(law, problem) for law in law_names for problem in problem_names if (law, problem) not in UNSOLVABLE]
    return pytest.mark.parametrize(("law_name", "problem_name"), pairs)


def resolve(law_name, problem_name):
    c = PROBLEMS[problem_name]()
    law = LAWS[law_name](c)
    return law, law.resolve(c)


@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_a_jump_that_a_law_knows_beforehand_reaches_its_target(problem_name):
    """A wrong jump would be found by the certificate, but at the cost of a solver call."""
    c, known = PROBLEMS[problem_name](), []
    for make in LAWS.values():
        law = make(c)
        problem = jump_problem(c, aim(law, c))
        if problem.preimage is not None:
            known.append(law)
            bound = problem.gradients @ problem.preimage
            np.testing.assert_allclose(bound, problem.bound, rtol=1e-9, atol=1e-12 * problem.scale)
    assert len(known) >= 5


@pytest.mark.parametrize(("law_name", "problem_name"), [(law, problem) for law in LAWS for problem in PROBLEMS])
def test_solvable_exactly_where_a_velocity_exists(law_name, problem_name):
    """Against an independent linear program for ``J v >= gamma^h``."""
    c = PROBLEMS[problem_name]()
    law = LAWS[law_name](c)
    lengths = np.linalg.norm(c.jacobian, axis=1)
    scale = np.where(lengths > 0, lengths, 1.0)
    feasible = not c.labels or (
        linprog(0 * c.pre_velocity, -c.jacobian / scale[:, None], -wanted(law, c) / scale, bounds=(None, None)).status
        == 0
    )
    assert feasible == ((law_name, problem_name) not in UNSOLVABLE)


@pytest.mark.parametrize(("law_name", "problem_name"), UNSOLVABLE)
def test_unsolvable(law_name, problem_name):
    with pytest.raises(UnsolvableLawError) as caught:
        resolve(law_name, problem_name)
    c = PROBLEMS[problem_name]()
    assert is_ray(caught.value.ray, c, LAWS[law_name](c))
    assert caught.value.contacts == UNSOLVABLE[law_name, problem_name]
    assert f"contacts {', '.join(caught.value.contacts)} ask for" in str(caught.value)
    assert caught.value.contacts == tuple(np.array(c.labels)[caught.value.ray > 0])


@solvable(LAWS, PROBLEMS)
def test_outcome(law_name, problem_name):
    law, impact = resolve(law_name, problem_name)
    c = impact.collision
    assert_certified(impact, law)

    M, J, lam = c.mass_matrix, c.jacobian, impact.impulse
    balance = M @ (impact.post_velocity - c.pre_velocity) - J.T @ lam
    largest = np.abs(M) @ np.abs(impact.post_velocity) + np.abs(M) @ np.abs(c.pre_velocity) + np.abs(J).T @ lam
    assert (np.abs(balance) <= 1e-9 * largest.max(initial=0.0)).all()

    gained = energy(c, impact.post_velocity) - energy(c, c.pre_velocity)
    rounding = 1e-9 * (energy(c, impact.post_velocity) + energy(c, c.pre_velocity))
    assert impact.energy_change == pytest.approx(gained, abs=rounding)
    assert lam @ impact.mean_contact_velocity == pytest.approx(gained, abs=rounding)

    induced = impact.induced_impulse * np.linalg.solve(M, impact.induced_gradient)
    np.testing.assert_allclose(c.pre_velocity + induced, impact.post_velocity, atol=1e-9 * np.abs(largest).max())
    assert impact.topology.sum() == pytest.approx(1.0 if lam.any() else 0.0, abs=1e-12)
    assert impact.induced_impulse == pytest.approx(lam.sum(), rel=1e-12)


@solvable(DIAGONAL, CLOSING)
def test_diagonal_law_on_closing_contacts_has_no_distant_effect_and_stays_admissible(law_name, problem_name):
    _, impact = resolve(law_name, problem_name)
    assert not impact.has_distant_effect
    assert impact.violations.energetic <= 1e-14 * impact.collision.pre_speed
    assert impact.violations.is_admissible()


@solvable(LAWS, [name for name, make in PROBLEMS.items() if len(make().labels) <= 6])
def test_velocity_agrees_with_rational_arithmetic(law_name, problem_name):
    law, impact = resolve(law_name, problem_name)
    c = impact.collision
    L = np.linalg.cholesky(c.mass_matrix)
    error = L.T @ (impact.post_velocity - exact_velocity(c, wanted(law, c), least_impulse(law, impact)))
    assert np.linalg.norm(error) <= 1e-9 * np.linalg.norm(L.T @ c.pre_velocity)


@pytest.mark.parametrize("problem_name", PROBLEMS)
@pytest.mark.parametrize("law_name", LAWS)
def test_target(law_name, problem_name):
    """The target is gamma^h by definition, and the velocity that a law provides with it reaches it."""
    c = PROBLEMS[problem_name]()
    law = LAWS[law_name](c)
    target = law.target(c)
    np.testing.assert_allclose(target.contact_velocity, wanted(law, c), rtol=1e-13, atol=1e-13)
    velocity = target.velocity if target.coefficient is None else -target.coefficient * c.pre_velocity
    if velocity is not None:
        np.testing.assert_allclose(c.jacobian @ velocity, target.contact_velocity, rtol=1e-13, atol=1e-13)
    if law_name in {"maximal dissipation", "moreau 0.5", "newton scalar", "linear map"} and c.labels:
        assert velocity is not None


def test_unsolvable_law_names_the_contacts_that_conflict():
    """A ball between two walls must leave the first wall with 0.9, but may move towards the second with at most 0.1."""
    labels = ("ball/left", "ball/floor", "ball/right")
    c = Collision(np.eye(2), [[1.0, 0.0], [0.0, 1.0], [-2.0, 0.0]], [-1.0, -1.0], labels=labels)
    law = Newton({"ball/left": 0.9, "ball/right": 0.1}, default=0.5)
    with pytest.raises(UnsolvableLawError, match="contacts ball/left, ball/right ask for") as caught:
        law.resolve(c)
    assert caught.value.contacts == ("ball/left", "ball/right")
    np.testing.assert_allclose(caught.value.ray, [1.0, 0.0, 0.5], **EXACT)
    assert isinstance(caught.value, ImpactLawError)
    assert Newton({"ball/left": 0.1, "ball/right": 0.9}, default=0.5).resolve(c).residual < 1e-12


def test_law_that_wants_to_move_a_contact_that_cannot_move():
    c = Collision(np.eye(2), [[0.0, 0.0], [1.0, 0.0]], [-1.0, 2.0])
    with pytest.raises(UnsolvableLawError) as caught:
        Fremond([[0.0, 1.0], [0.0, 0.0]]).resolve(c)
    assert caught.value.contacts == ("0",)


# --- relations between laws ------------------------------------------------------------------------------------------


def outcome(law, c):
    impact = law.resolve(c)
    return np.concatenate([impact.post_velocity, impact.impulse])


@pytest.mark.parametrize("problem_name", ["three balls", "rod", "random dense", "rank deficient", "box on 64 points"])
def test_one_law_in_several_forms(problem_name):
    c = PROBLEMS[problem_name]()
    h, nv = c.jacobian.shape
    e = 0.37
    for law in (Newton(e), Newton([e] * h), Fremond(e * np.eye(h)), LinearMap(-e * np.eye(nv))):
        np.testing.assert_allclose(outcome(law, c), outcome(Moreau(e), c), atol=1e-10)
    for law in (Moreau(0), Newton(0), Fremond(np.zeros((h, h))), LinearMap(np.zeros((nv, nv)))):
        np.testing.assert_allclose(outcome(law, c), outcome(MaximalDissipation(), c), atol=1e-10)


@pytest.mark.parametrize("problem_name", ["three balls", "rod", "random dense", "box on 64 points"])
def test_diagonal_matrix_is_newton(problem_name):
    c = PROBLEMS[problem_name]()
    each = np.linspace(0.0, 1.0, len(c.labels))
    np.testing.assert_allclose(outcome(Fremond(np.diag(each)), c), outcome(Newton(each.tolist()), c), atol=1e-10)


def test_linear_map_reflects():
    """h, the reflection at the hyperplane of one contact, is an elastic impact there."""
    c = Collision(np.eye(3), [[0.0, 0.0, 1.0]], [1.0, 2.0, -3.0])
    impact = LinearMap(np.diag([1.0, 1.0, -1.0])).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [1.0, 2.0, 3.0], **EXACT)


@settings(deadline=None, derandomize=True, max_examples=200)
@given(
    seed=st.integers(0, 2**32 - 1),
    e=st.floats(0.0, 1.0),
    factor=st.floats(1e-6, 1e6),
)
def test_units_and_coordinates_do_not_matter(seed, e, factor):
    """Masses, gaps and velocities are scaled, coordinates transformed, and contacts permuted."""
    rng = np.random.default_rng(seed)
    h, nv = int(rng.integers(1, 6)), int(rng.integers(6, 9))
    A, J, v = rng.normal(size=(nv, nv)), rng.normal(size=(h, nv)), rng.normal(size=nv)
    M = A @ A.T + np.eye(nv)
    law = Moreau(e)
    post, lam = (i := law.resolve(Collision(M, J, v))).post_velocity, i.impulse
    close = {"rtol": 1e-9, "atol": 1e-10}

    heavier = law.resolve(Collision(factor * M, J, v))
    np.testing.assert_allclose(heavier.post_velocity, post, **close)
    np.testing.assert_allclose(heavier.impulse / factor, lam, **close)
    faster = law.resolve(Collision(M, J, factor * v))
    np.testing.assert_allclose(faster.post_velocity / factor, post, **close)
    gaps = factor ** rng.uniform(-1, 1, h)
    rescaled = law.resolve(Collision(M, J * gaps[:, None], v))
    np.testing.assert_allclose(rescaled.post_velocity, post, **close)
    np.testing.assert_allclose(rescaled.impulse * gaps, lam, **close)
    T = np.linalg.qr(rng.normal(size=(nv, nv)))[0] * np.exp(rng.normal(size=nv))
    other = law.resolve(Collision(T.T @ M @ T, J @ T, np.linalg.solve(T, v)))
    np.testing.assert_allclose(T @ other.post_velocity, post, rtol=1e-7, atol=1e-8)
    order = rng.permutation(h)
    shuffled = law.resolve(Collision(M, J[order], v))
    np.testing.assert_allclose(shuffled.impulse, lam[order], **close)


def test_laws_are_equal_only_if_they_are():
    first, second = Fremond([[1.0]]), Fremond([[0.0]])
    assert first != second
    assert len({first, second}) == 2
    assert Coulomb(first) != Coulomb(second)
    assert Moreau(0.5) == Moreau(0.5)
    assert LinearMap([[1.0]]) != LinearMap([[2.0]])


def test_a_linear_map_beside_constraints_leads_to_the_nearest_velocity():
    """The reachable velocities are ``v- + P M^-1 J^T Lambda``, where P projects onto the admissible velocities."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        rows, J, v = rng.normal(size=(1, 4)), rng.normal(size=(2, 4)), rng.normal(size=4)
        v -= rows[0] * (rows[0] @ v) / (rows[0] @ rows[0])
        v = -v if (J @ v > 0).all() else v
        free = np.eye(4) - rows.T @ rows / (rows @ rows.T)
        h = rng.normal(size=(4, 4))
        impact = LinearMap(h).resolve(Collision(np.eye(4), J, v, bilateral_jacobian=rows))
        found, residual = nnls((J @ free).T, free @ (h @ v - v))
        reached = v + free @ J.T @ found
        if (J @ reached >= -1e-9).all():
            gap = np.linalg.norm(free @ (h @ v - impact.post_velocity))
            assert gap <= residual + 1e-9


def test_an_unknown_solver_is_refused_with_friction_too():
    friction = Friction([[1.0, 0.0]], [0], [0.5])
    collision = Collision(np.eye(2), [[0.0, 1.0]], [1.0, -1.0], friction=friction)
    with pytest.raises(UnknownNameError, match="bogus"):
        Coulomb(Moreau(0.5)).resolve(collision, solver="bogus")
