"""Poisson's law: answers by hand, relations to Moreau's and Newton's laws, and outcomes within S."""

import numpy as np
import pytest
from certificates import least_norm_error
from problems import PROBLEMS, box, launched, rod

from impactlaw import Collision, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.errors import UnsolvableLawError

EXACT = {"rtol": 0, "atol": 1e-12}


@pytest.mark.parametrize(
    ("e", "opening", "impulse"),
    [
        ((1, 1), (1, 0), (4 / 3, 2 / 3)),
        ((0, 0), (0, 0), (2 / 3, 1 / 3)),
        ((1, 0), (1, 0), (4 / 3, 2 / 3)),  # e_2 < e_1: the second contact needs the same impulse as with e_1
        ((0.6, 0.2), (0.6, 0), (1.6 * 2 / 3, 1.6 / 3)),
        ((0.5, 1), (1 / 3, 1 / 3), (1, 2 / 3)),  # e_1 < e_2 < 4 e_1: both open, with the impulses of compression
        ((0.3, 0.9), (0.1, 0.4), (1.3 * 2 / 3, 1.9 / 3)),
        ((0, 1), (0, 1 / 2), (5 / 6, 2 / 3)),  # e_2 > 4 e_1: the recoil of ball 2 presses on ball 1
        ((0.1, 0.8), (0, 0.4), (2.2 / 3 + 0.4 / 6, 1.8 / 3)),
    ],
)
def test_three_balls(e, opening, impulse):
    """Lambda_C = (2, 1) / 3; the contacts open with (4 e_1 - e_2, 2 e_2 - 2 e_1) / 3, if neither is negative."""
    impact = Poisson(e).resolve(launched(3, 1))
    np.testing.assert_allclose(impact.compression.impulse, (2 / 3, 1 / 3), **EXACT)
    np.testing.assert_allclose(impact.compression.post_velocity, 1 / 3, **EXACT)
    np.testing.assert_allclose(impact.post_contact_velocity, opening, **EXACT)
    np.testing.assert_allclose(impact.impulse, impulse, **EXACT)
    np.testing.assert_allclose(impact.post_velocity, (1 - impulse[0], impulse[0] - impulse[1], impulse[1]), **EXACT)
    assert impact.has_distant_effect == (opening[1] > 0)
    assert impact.residual < 1e-15
    assert impact.violations.is_admissible(1e-15)
    newton = Newton(e).resolve(launched(3, 1))
    np.testing.assert_allclose(newton.post_contact_velocity, (e[0], 0), **EXACT)  # contact 2 is known to be at rest


def test_rod_on_two_supports():
    """An elastic and a dead end: compression gives (1, 1) / 2, the elastic end gets 1/2 more, then the dead one 1/4."""
    impact = Poisson([1.0, 0.0]).resolve(rod())
    np.testing.assert_allclose(impact.compression.impulse, (1 / 2, 1 / 2), **EXACT)
    np.testing.assert_allclose(impact.least_impulse, (1, 1 / 2), **EXACT)
    np.testing.assert_allclose(impact.impulse, (1, 3 / 4), **EXACT)
    np.testing.assert_allclose(impact.post_contact_velocity, (3 / 2, 0), **EXACT)  # faster than it approached
    assert impact.energy_change / impact.collision.kinetic_energy == pytest.approx(-1 / 4, abs=1e-12)
    assert impact.antidissipative.tolist() == [True, False]
    assert impact.violations.is_admissible(1e-15)
    newton = Newton([1.0, 0.0]).resolve(rod())
    assert newton.energy_change / rod().kinetic_energy == pytest.approx(-2 / 3, abs=1e-12)
    assert not newton.has_distant_effect


@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("problem_name", ["all separating", "zero velocity", "no contact"])
def test_nothing_happens(problem_name, e):
    impact = Poisson(e).resolve(PROBLEMS[problem_name]())
    np.testing.assert_array_equal(impact.post_velocity, impact.collision.pre_velocity)
    np.testing.assert_array_equal(impact.impulse, np.zeros(len(impact.collision.labels)))
    assert (impact.energy_change, impact.residual) == (0, 0)
    assert impact.violations.is_admissible(0.0)


def ordinary(seed: int) -> Collision:
    """Return up to eight independent contacts of a random system, closing or not."""
    rng = np.random.default_rng([51, seed])
    h = int(rng.integers(1, 9))
    nv = h + int(rng.integers(0, 4))
    A = rng.normal(size=(nv, nv))
    return Collision(A @ A.T + np.eye(nv), rng.normal(size=(h, nv)), rng.normal(size=nv))


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_equal_coefficients_are_moreau_or_its_projection_on_the_tangent_cone(problem_name, e):
    c = PROBLEMS[problem_name]()
    moreau = Moreau(e).resolve(c).post_velocity
    nearest = MaximalDissipation().resolve(Collision(c.mass_matrix, c.jacobian, moreau)).post_velocity
    gap = c.metric.norm(Poisson(e).resolve(c).post_velocity - nearest)
    assert gap <= 1e-9 * c.pre_speed
    if (c.pre_contact_velocity <= 0).all():
        assert c.metric.norm(moreau - nearest) <= 1e-9 * c.pre_speed


def test_where_newton_penetrates_and_gains_energy_poisson_does_not():
    """If some contacts open and others close before the impact, Newton's law may leave S."""
    broken = {"kinematic": 0, "energetic": 0}
    distant = 0
    for seed in range(300):
        c = ordinary(seed)
        e = np.random.default_rng([52, seed]).uniform(size=len(c.labels)).tolist()
        newton, poisson = Newton(e).resolve(c), Poisson(e).resolve(c)
        broken["kinematic"] += newton.violations.kinematic > 1e-6 * c.pre_speed
        broken["energetic"] += newton.violations.energetic > 1e-6 * c.pre_speed
        assert poisson.violations.is_admissible(1e-12)
        assert (poisson.impulse >= (1 + np.array(e)) * poisson.compression.impulse * (1 - 1e-15)).all()
        assert poisson.residual < 1e-12
        distant += poisson.has_distant_effect
    assert broken["kinematic"] > 30
    assert broken["energetic"] > 0
    assert distant > 30


@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_admissible_on_every_problem(problem_name):
    c = PROBLEMS[problem_name]()
    for seed in range(10):
        e = np.random.default_rng([53, seed]).integers(0, 2, len(c.labels)).astype(float)
        impact = Poisson(e.tolist()).resolve(c)
        assert impact.violations.is_admissible()
        assert c.admissible_set.contains(impact.post_velocity, 1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_units_coordinates_and_order_do_not_matter(seed):
    c = ordinary(seed)
    rng = np.random.default_rng([54, seed])
    e = rng.uniform(size=len(c.labels))
    base = Poisson(e.tolist()).resolve(c)
    order, gaps = rng.permutation(len(e)), 10.0 ** rng.uniform(-3, 3, len(e))
    J = (c.jacobian * gaps[:, None])[order]
    other = Poisson(e[order].tolist()).resolve(Collision(1e3 * c.mass_matrix, J, 1e-2 * c.pre_velocity))
    np.testing.assert_allclose(1e2 * other.post_velocity, base.post_velocity, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other.impulse * gaps[order], 10 * base.impulse[order], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 2.0])
def test_compression_is_of_least_norm_where_contacts_are_redundant(tilt):
    c = box(8, tilt)
    impact = Poisson(0.5).resolve(c)
    first = impact.compression
    tight = first.post_contact_velocity <= 1e-9
    assert least_norm_error(first.impulse, tight, c.jacobian) < 1e-12
    rows = impact.impulse.reshape(8, 8)
    np.testing.assert_allclose(rows, np.repeat(rows.mean(axis=1, keepdims=True), 8, axis=1), **EXACT)
    np.testing.assert_allclose(impact.post_velocity, Moreau(0.5).resolve(c).post_velocity, **EXACT)


@pytest.mark.parametrize("copies", [2, 5])
def test_duplicates_share_alike(copies):
    c, e = launched(4, 2), [0.3, 0.8, 0.5]
    one = Poisson(e).resolve(c)
    J = np.repeat(c.jacobian, copies, axis=0)
    many = Poisson(np.repeat(e, copies).tolist()).resolve(Collision(c.mass_matrix, J, c.pre_velocity))
    np.testing.assert_allclose(many.post_velocity, one.post_velocity, **EXACT)
    np.testing.assert_allclose(many.impulse, np.repeat(one.impulse, copies) / copies, **EXACT)


def test_two_copies_of_a_support_give_the_mean_of_their_coefficients():
    """Each copy takes half of the compression; Newton's law follows the larger coefficient."""
    c = Collision([[2.0]], [[1.0], [1.0]], [-1.0])
    np.testing.assert_allclose(Poisson([0.8, 0.2]).resolve(c).post_velocity, [0.5], **EXACT)
    np.testing.assert_allclose(Newton([0.8, 0.2]).resolve(c).post_velocity, [0.8], **EXACT)


def test_a_ball_between_two_walls():
    """It bounces off the first wall with 0.8 and the second stops it at once; Newton's law has no solution."""
    c = Collision([[2.0]], [[1.0], [-1.0]], [-1.0])
    with pytest.raises(UnsolvableLawError):
        Newton([0.8, 0.2]).resolve(c)
    impact = Poisson([0.8, 0.2]).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [0.0], **EXACT)
    np.testing.assert_allclose(impact.impulse, [3.6, 1.6], **EXACT)
