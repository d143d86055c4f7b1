"""The admissible set of any collision: projections, samples and support agree with each other and an optimizer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from problems import PROBLEMS, balls, box, launched
from scipy.optimize import minimize
from scipy.stats import kstest

from impactlaw import Collision, MaximalDissipation, Moreau
from impactlaw.mechanics.admissible.cone import cone_facets

SMALL = [name for name in PROBLEMS if name != "chain of 64"]
UNIFORM = 1e-3  # smallest p-value of Kolmogorov's test; the seeds are fixed


def far_and_near(c, rng, n=12):
    """Return velocities at distances of 1e-3 to 1e3 times |v-| from v-."""
    z = rng.normal(size=(n, len(c.pre_velocity))) * 10.0 ** rng.uniform(-3, 3, (n, 1))
    return c.pre_velocity + c.pre_speed * c.metric.unwhiten(z)


@pytest.mark.parametrize("name", SMALL)
def test_intensities_of_samples_are_in_the_range_and_its_ends_are_attained(name):
    c = PROBLEMS[name]()
    S = c.admissible_set
    least, largest = S.intensity_range()
    rho = np.linalg.norm(c.metric.whiten(S.sample(300, 6) - c.pre_velocity), axis=1)
    tol = 1e-10 * c.pre_speed
    assert least - tol <= rho.min()
    assert rho.max() <= largest + tol
    p = MaximalDissipation().resolve(c).post_velocity
    assert c.metric.norm(p - c.pre_velocity) == pytest.approx(least, abs=1e-9 * c.pre_speed)
    if (c.pre_contact_velocity <= 0).all():
        assert S.contains(2 * p - c.pre_velocity)
        assert largest == pytest.approx(2 * least)


@pytest.mark.parametrize("name", SMALL)
def test_samples_projections_and_support_agree(name):
    """Projections are members with ``<v - p, s - p> <= 0`` for all s in S; the support bounds all samples."""
    c, rng = PROBLEMS[name](), np.random.default_rng(7)
    S = c.admissible_set
    samples = S.sample(100, rng)
    assert all(map(S.contains, samples))
    s = c.metric.whiten(samples)
    tol = 1e-9 * c.pre_speed
    assert max(map(S.distance, samples)) <= tol
    for v in far_and_near(c, rng):
        p = S.project(v)
        assert S.contains(p)
        gap = c.metric.whiten(v - p)
        distance = np.linalg.norm(gap)
        assert S.distance(v) == pytest.approx(distance, abs=tol)
        assert c.metric.norm(S.project(p) - p) <= tol
        if distance > tol:
            assert ((s - c.metric.whiten(p)) @ gap).max() <= tol * distance
            # p is the point of S farthest in the direction of v
            assert S.support(v - p) == pytest.approx(gap @ c.metric.whiten(p), abs=tol * distance)
        u = c.metric.whiten(v)
        assert (s @ u).max() <= S.support(v) + tol * np.linalg.norm(u)
        assert S.support(3 * v) == pytest.approx(3 * S.support(v), abs=tol * np.linalg.norm(u))


def _by_slsqp(c, v):
    """Return the member of S nearest to v, by an optimization over the impulses."""
    Y, z, target = c.whitened_jacobian, c.whitened_velocity, c.metric.whiten(v)
    best = minimize(
        lambda x: 0.5 * np.sum((z + x @ Y - target) ** 2),
        np.zeros(len(Y)),
        jac=lambda x: Y @ (z + x @ Y - target),
        bounds=[(0, None)] * len(Y),
        constraints=[
            {"type": "ineq", "fun": lambda x: Y @ (z + x @ Y), "jac": lambda x: Y @ Y.T},
            {"type": "ineq", "fun": lambda x: z @ z - np.sum((z + x @ Y) ** 2), "jac": lambda x: -2 * Y @ (z + x @ Y)},
        ],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return c.metric.unwhiten(z + best.x @ Y)


@pytest.mark.parametrize(
    "name", ["three balls", "five balls", "rod", "tilted box", "duplicated contacts", "random dense"]
)
def test_projection_is_that_of_an_independent_optimiser(name):
    c, rng = PROBLEMS[name](), np.random.default_rng(8)
    for v in c.pre_velocity + c.pre_speed * c.metric.unwhiten(rng.normal(size=(8, len(c.pre_velocity)))):
        p, other = c.admissible_set.project(v), _by_slsqp(c, v)
        distance = c.metric.norm(v - other)
        penetration = np.maximum(-c.jacobian @ other / c.gradient_norms, 0.0).sum()
        outside = max(c.metric.norm(other) - c.pre_speed, 0.0) + penetration  # the optimizer's own violation
        assert c.metric.norm(v - p) == pytest.approx(distance, abs=1e-9 * distance + outside)
        assert c.metric.norm(p - other) <= 1e-5 * c.pre_speed  # the distance has twice the digits of the point


def test_grazing_is_as_exact_as_rounding_allows():
    """S shrinks with the closing speed: at 1e-8 of |v-| it is still the sector, to 1e-16 of |v-|."""
    c = Collision(np.eye(3), np.eye(3)[:2], [-1e-8, -1e-8, 1.0])
    S = c.admissible_set
    v = S.sample(2000, 9)
    assert kstest((v[:, 0] ** 2 + v[:, 1] ** 2) / 2e-16, "uniform").pvalue > UNIFORM
    np.testing.assert_allclose(S.project([1.0, 0.5e-8, 9.0]), np.array([np.sqrt(2) * 1e-8, 0, 1]), atol=1e-8)
    np.testing.assert_allclose(S.project([3e-8, -1.0, 1.0]), [np.sqrt(2) * 1e-8, 0, 1], atol=1e-15)


@pytest.mark.parametrize("speed", [1e-12, 1e8])
def test_everything_scales_with_the_speed(speed):
    one, other = launched(4, 2), balls(np.ones(4), speed * np.array([1.0, 1.0, 0.0, 0.0]))
    S, T = one.admissible_set, other.admissible_set
    v = np.array([0.4, -2.0, 1.0, 0.3])
    np.testing.assert_allclose(T.project(speed * v), speed * S.project(v), atol=1e-12 * speed)
    assert T.support(v) == pytest.approx(speed * S.support(v))
    assert T.intensity_range() == pytest.approx(tuple(speed * np.array(S.intensity_range())))
    np.testing.assert_allclose(T.sample(5, 0), speed * S.sample(5, 0), atol=1e-9 * speed)


def test_long_chain_and_pile_of_boxes():
    """64 contacts in a row; five boxes on four corners each, whose cone has 4 facets per box, not 4^5."""
    c = PROBLEMS["chain of 64"]()
    v = far_and_near(c, np.random.default_rng(10), 2)[0]
    p = c.admissible_set.project(v)
    assert c.admissible_set.contains(p)
    gap = c.metric.whiten(v - p)
    assert c.admissible_set.support(v - p) == pytest.approx(gap @ c.metric.whiten(p), abs=1e-9 * np.linalg.norm(gap))
    one = box(tilt=0.4)
    rows = np.kron(np.eye(5) - np.eye(5, k=-1), one.jacobian)
    pile = Collision(np.kron(np.eye(5), one.mass_matrix), rows, np.tile(one.pre_velocity, 5))
    gradients = rows[:, np.any(rows != 0, axis=0)]
    basis = np.linalg.svd(gradients)[2][: np.linalg.matrix_rank(gradients)]
    units = gradients @ basis.T
    assert cone_facets(units / np.linalg.norm(units, axis=1)[:, None]).shape == (20, 15)
    assert pile.admissible_set.contains(pile.admissible_set.project(np.ones(30)))


@st.composite
def collisions(draw):
    """Draw up to 6 contacts with up to 5 velocities, in small integers so that gradients are often dependent."""
    h, nv = draw(st.integers(0, 6)), draw(st.integers(1, 5))
    J = draw(arrays(float, (h, nv), elements=st.integers(-2, 2).map(float)))
    v = draw(arrays(float, nv, elements=st.integers(-3, 3).map(float)))
    masses = draw(arrays(float, nv, elements=st.sampled_from([1e-3, 0.5, 1.0, 2.0, 1e3])))
    A = draw(arrays(float, (nv, nv), elements=st.sampled_from([0.0, 0.0, 0.25, -0.5])))
    M = np.sqrt(masses)[:, None] * (np.eye(nv) + A @ A.T) * np.sqrt(masses)
    return Collision(0.5 * (M + M.T), J, draw(st.sampled_from([1e-6, 1.0, 1e5])) * v)


@settings(max_examples=80, deadline=None)
@given(collisions(), st.integers(0, 2**32 - 1))
def test_any_collision(c, seed):
    S, rng = c.admissible_set, np.random.default_rng(seed)
    tol = 1e-9 * c.pre_speed
    member = S.sample(2, rng)[0]
    assert S.contains(member)
    assert c.metric.norm(S.project(member) - member) <= tol
    v = far_and_near(c, rng, 1)[0]
    p = S.project(v)
    assert S.contains(p)
    assert c.metric.norm(S.project(p) - p) <= tol
    assert S.distance(v) == pytest.approx(c.metric.norm(v - p), abs=tol)
    gap = c.metric.whiten(v - p)
    if np.linalg.norm(gap) > tol:
        assert c.metric.whiten(member - p) @ gap <= tol * np.linalg.norm(gap)
    assert S.support(v) >= c.metric.whiten(member) @ c.metric.whiten(v) - tol * c.metric.norm(v)


@settings(max_examples=80, deadline=None)
@given(collisions(), st.floats(0, 1))
def test_outcomes_of_laws_are_members(c, e):
    """Maximal dissipation always; Moreau if no contact separates before the impact."""
    outcomes = [MaximalDissipation().resolve(c).post_velocity]
    if (c.pre_contact_velocity <= 0).all():
        outcomes.append(Moreau(e).resolve(c).post_velocity)
    for v in outcomes:
        assert c.admissible_set.contains(v)
        assert c.admissible_set.distance(v) <= 1e-9 * c.pre_speed
