"""Contacts that act as springs for a short time: known outcomes, limits, order, admissibility."""

import mujoco
import numpy as np
import pytest
from problems import balls, launched
from scipy.integrate import solve_ivp

from impactlaw import Collision, Compliant, Coulomb, Friction, Moreau, Newton, Stepper, make_law
from impactlaw.errors import InvalidCollisionError, RestitutionError, SolverError
from impactlaw.mechanics.spring_contacts import spring_impulses
from impactlaw.models import load

HERTZ_3 = (-0.0710, 0.0764, 0.9945)
HERTZ_5 = (-0.071, -0.030, -0.015, 0.127, 0.989)
LINEAR_3 = (-0.1303, 0.1502, 0.9800)


def ordinary(rng: np.random.Generator) -> Collision:
    """Return up to eight independent contacts of a random system, closing or not."""
    h = int(rng.integers(1, 9))
    nv = h + int(rng.integers(0, 4))
    A = rng.normal(size=(nv, nv))
    return Collision(A @ A.T + 0.1 * np.eye(nv), rng.normal(size=(h, nv)), rng.normal(size=nv))


@pytest.mark.parametrize(
    ("balls_in", "exponent", "velocity"), [(3, 1.5, HERTZ_3), (5, 1.5, HERTZ_5), (3, 1.0, LINEAR_3)]
)
def test_known_chains(balls_in, exponent, velocity):
    v = Compliant(7.0, exponent=exponent).resolve(launched(balls_in, 1)).post_velocity
    np.testing.assert_allclose(v, velocity, rtol=0, atol=1e-3)


def test_chain_against_another_integrator():
    """Four unequal balls with unequal springs, against scipy's DOP853 on the positions of the balls."""
    m, k, p = np.array([1.0, 2.0, 0.7, 1.5]), np.array([1.0, 5.0, 0.4]), 1.5

    def rates(_, state):
        x, v = state[:4], state[4:]
        f = k * np.maximum(-np.diff(x), 0.0) ** p
        return np.concatenate([v, (np.concatenate([[0.0], f]) - np.concatenate([f, [0.0]])) / m])

    start = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.2, 0.0, -0.5])
    reference = solve_ivp(rates, (0.0, 60.0), start, method="DOP853", rtol=1e-11, atol=1e-13).y[4:, -1]
    assert (np.diff(reference) >= 0).all()
    found = Compliant(k, exponent=p).resolve(balls(m, start[4:])).post_velocity
    np.testing.assert_allclose(found, reference, rtol=0, atol=1e-8)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 2.3])
@pytest.mark.parametrize("e", [1.0, 0.9, 0.3, 0.05])
def test_one_contact_returns_e(exponent, e):
    c = Collision([[2.0]], [[3.0]], [-4.0])
    v = Compliant(5.0, exponent=exponent, restitution=e).resolve(c).post_velocity
    np.testing.assert_allclose(v, [4.0 * e], rtol=0, atol=1e-8)


def test_two_blocks_on_one_contact_each_are_newtons():
    c = Collision(np.diag([1.0, 3.0]), np.eye(2), [-1.0, -2.0])
    v = Compliant([1.0, 100.0], restitution=0.6).resolve(c).post_velocity
    np.testing.assert_allclose(v, Newton(0.6).resolve(c).post_velocity, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("ratio", "limit"), [(1e-7, (0.0, 0.0, 1.0)), (1e7, (-1 / 3, 2 / 3, 2 / 3))])
def test_stiffness_ratio_leads_to_the_corners(ratio, limit):
    v = Compliant([1.0, ratio]).resolve(launched(3, 1)).post_velocity
    np.testing.assert_allclose(v, limit, rtol=0, atol=2e-5)


def test_corners_are_reached_monotonically():
    ratios = (1e-3, 1e-2, 0.1, 1.0)
    last = [Compliant([1.0, ratio]).resolve(launched(3, 1)).post_velocity[2] for ratio in ratios]
    assert (np.diff(last) < 0).all()


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_order_four(exponent):
    J = np.diff(np.eye(4), axis=0)
    G = J @ J.T / 2.0
    y = np.array([[-1.0, 0.0, 0.2]])
    deepest = np.full((1, 3), 1.5)

    def found(step):
        return spring_impulses(G, y, np.array([1.0, 0.6, 0.8]), exponent, 0.0, deepest, step)[0][0]

    exact = found(0.01)
    coarse, fine = (np.abs(found(step) - exact).max() for step in (0.32, 0.08))
    assert coarse / fine > 0.5 * 4.0**4
    energies = [abs(found(step) @ y[0] + 0.5 * found(step) @ G @ found(step)) for step in (0.32, 0.08, 0.02)]
    assert energies[0] > 30 * energies[1] > 900 * energies[2]


def test_homogeneous_and_free_of_units():
    rng = np.random.default_rng(3)
    for _ in range(10):
        c, law = ordinary(rng), Compliant(2.0)
        base = law.resolve(c)
        slow = Collision(1e3 * c.mass_matrix, c.jacobian, 1e-3 * c.pre_velocity)
        np.testing.assert_allclose(1e3 * law.resolve(slow).post_velocity, base.post_velocity, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(Compliant(1e9).resolve(c).post_velocity, base.post_velocity, rtol=1e-10, atol=1e-10)


def test_stays_in_the_admissible_set():
    """1 000 random collisions, stiffnesses over four decades; elastic ones also conserve energy."""
    worst, refused = 0.0, 0
    for seed in range(1000):
        rng = np.random.default_rng([9, seed])
        c = ordinary(rng)
        exponent, e = rng.choice([1.0, 1.5, 2.0, rng.uniform(1, 3)]), rng.choice([1.0, rng.uniform(0.05, 1)])
        law = Compliant(10.0 ** rng.uniform(-2, 2, len(c.labels)), exponent=exponent, restitution=e)
        try:
            impact = law.resolve(c)
        except SolverError:
            refused += 1
            continue
        v = impact.violations
        worst = max(worst, max(v.kinematic, v.kinetic, v.energetic) / v.pre_speed)
        if e == 1.0:
            assert abs(impact.energy_change) < 1e-7 * c.kinetic_energy
    assert worst < 1e-6
    assert refused <= 2


def test_many_at_once_are_the_same_one_by_one():
    rng = np.random.default_rng(4)
    c, law = launched(4, 1), Compliant([1.0, 2.0, 3.0])
    gamma = rng.normal(size=(20, 3))
    many = law.impulses(c.delassus, gamma)
    for one, impulse in zip(gamma, many, strict=True):
        v = np.concatenate([[0.0], np.cumsum(one)])
        np.testing.assert_allclose(law.resolve(balls(np.ones(4), v)).impulse, impulse, rtol=0, atol=1e-9)


def test_what_bounces_for_ever_is_refused():
    walls = Collision([[1.0]], [[1.0], [-1.0]], [-1.0])
    with pytest.raises(SolverError, match="do not come to an end"):
        Compliant(1.0).resolve(walls)


@pytest.mark.parametrize("stiffness", ["2", True, {1.0, 2.0}, b"12", [1.0, "2"], {"a/b": True}])
def test_what_is_no_number_is_refused(stiffness):
    """As for coefficients of restitution; a set has no order, and the bytes of a text are not stiffnesses."""
    with pytest.raises(RestitutionError, match=r"positive number|in order"):
        Compliant(stiffness)


def test_friction_goes_around_it():
    row = Friction([[1.0, 0.0]], [0], [0.3])
    c = Collision(np.eye(2), [[0.0, 1.0]], [5.0, -1.0], friction=row)
    ours, moreau = Coulomb(Compliant(1.0)).resolve(c), Coulomb(Moreau(1.0)).resolve(c)
    np.testing.assert_allclose(ours.post_velocity, moreau.post_velocity, rtol=0, atol=1e-9)


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}])
def test_cradle_in_every_way_to_step(options):
    """The first ball hits four balls at rest: every way to step gives them the velocities of the law."""
    model, data = load("newtons_cradle")
    stepper = Stepper(model, make_law("compliant"), **options)
    while data.time < 1.5 and not stepper.events:
        stepper.step(data)
    impact = stepper.events[0].impact
    expected = make_law("compliant").resolve(impact.collision).post_velocity
    assert impact.violations.is_admissible(1e-8)
    np.testing.assert_allclose(impact.post_velocity, expected, rtol=0, atol=1e-6 * impact.collision.pre_speed)
    mujoco.mj_energyVel(model, data)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Compliant(0.0), "stiffness must be a positive number, and finite, got 0.0"),
        (lambda: Compliant("hard"), "stiffness must be a positive number"),
        (lambda: Compliant([1.0, np.nan]), "stiffness of contact 1 must be a positive number, and finite, got nan"),
        (lambda: Compliant({"a/b": 1.0, "b/a": 2.0}), "two restitutions"),
        (lambda: Compliant(1.0, exponent=0.5), r"exponent must lie in \[1, 4\]"),
        (lambda: Compliant(1.0, restitution=0.0), "never opens"),
        (lambda: Compliant(1.0, restitution=1.5), r"must lie in \[0, 1\]"),
        (lambda: Compliant([1.0]).resolve(launched(3, 1)), "has 1 stiffnesses but 2 contacts"),
        (lambda: Compliant({"a/b": 1.0}).resolve(launched(3, 1)), "no stiffness for contact 0"),
    ],
)
def test_wrong_numbers(make, message):
    with pytest.raises(RestitutionError, match=message):
        make()


def test_wrong_shapes():
    with pytest.raises(InvalidCollisionError, match="must be"):
        Compliant(1.0).impulses(np.eye(2), np.ones((3, 3)))


@pytest.mark.parametrize(
    ("delassus", "velocities", "message"),
    [
        ([[1.0, 0.0], [0.0, -1.0]], [[-1.0, -1.0]], "delassus is not symmetric and positive semidefinite"),
        ([[1.0, 2.0], [2.0, 1.0]], [[-1.0, -1.0]], "delassus is not symmetric and positive semidefinite"),
        ([[1.0, 0.5], [0.0, 1.0]], [[-1.0, -1.0]], "delassus is not symmetric and positive semidefinite"),
        ([[0.0, 0.5], [0.5, 1.0]], [[-1.0, -1.0]], "delassus is not symmetric and positive semidefinite"),
        ([[np.nan]], [[-1.0]], "delassus has entries that are not finite"),
        ([[1.0]], [[np.nan]], "pre_contact_velocities has entries that are not finite"),
        ("G", [[-1.0]], "delassus is not an array of numbers"),
        ([[1.0]], "v", "pre_contact_velocities is not an array of numbers"),
        ([[1.0]], None, "pre_contact_velocities has entries that are not finite"),
    ],
)
def test_what_is_no_delassus_matrix_or_no_velocity(delassus, velocities, message):
    with pytest.raises(InvalidCollisionError, match=message):
        Compliant(1.0).impulses(delassus, velocities)


def test_redundant_contacts_have_a_delassus_matrix():
    """Two contacts at one point share the impulse of a single contact: 2 N s for 1 kg at 1 m/s."""
    J = np.array([[1.0], [1.0]]) / 3.0
    impulse = Compliant(1.0).impulses(J @ J.T, [[-1.0, -1.0]])
    np.testing.assert_allclose(impulse @ J, [[6.0]], rtol=1e-9)
