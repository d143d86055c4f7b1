"""The set of possible right-velocities S(v-), against exact sets, an independent optimiser and random collisions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from problems import PROBLEMS, balls, box, launched
from scipy.optimize import minimize
from scipy.stats import ks_2samp, kstest

from impactlaw import AdmissibleSet, Collision, ImpactLawError, MaximalDissipation, Moreau
from impactlaw.errors import InvalidCollisionError, SolverError
from impactlaw.mechanics.admissible.cone import EnumerationError, cone_facets

SMALL = [name for name in PROBLEMS if name != "chain of 64"]
UNIFORM = 1e-3  # least p-value of Kolmogorov's test; the seeds are fixed


def corner():
    """A particle between two walls at x = 0 falls at 45 degrees onto a floor: S is x = 0, 0 <= y <= sqrt 2."""
    return Collision(np.eye(2), [[1, 0], [-1, 0], [0, 1]], [-1, -1])


def narrow_wedge():
    """A wedge of 10 degrees, met from 60 degrees: the elastic outcome would be behind the other side."""
    a, v = np.deg2rad([10, 60])
    return Collision(np.eye(2), [[0, 1], [np.sin(a), -np.cos(a)]], [np.cos(v), np.sin(v)])


def far_and_near(c, rng, n=12):
    """Velocities from a thousandth to a thousand times |v-| away from v-."""
    z = rng.normal(size=(n, len(c.pre_velocity))) * 10.0 ** rng.uniform(-3, 3, (n, 1))
    return c.pre_velocity + c.pre_speed * c.metric.unwhiten(z)


# --- three balls: a sector of 60 degrees ---------------------------------------------------------------------------


def test_three_balls_corners_and_what_is_beyond_them():
    S = launched(3, 1).admissible_set
    corners = np.array([[1, 1, 1], [-1, 2, 2], [0, 0, 3]]) / 3
    for v in corners:
        assert S.contains(v, 1e-12)
        assert S.distance(v) < 1e-12
    p, elastic, swapped = corners
    assert not S.contains(elastic + 1e-6 * (elastic - p))
    assert not S.contains(swapped - 1e-6 * (elastic - p))
    assert not S.contains([1, 0, 0])
    assert S.distance([1, 0, 0]) == pytest.approx(np.sqrt(2 / 3), abs=1e-12)
    np.testing.assert_allclose(S.project([1, 0, 0]), p, atol=1e-12)
    np.testing.assert_allclose(S.project([-5, 10, 10]), elastic, atol=1e-12)
    np.testing.assert_allclose(S.intensity_range(), [np.sqrt(2 / 3), 2 * np.sqrt(2 / 3)], atol=1e-12)


def test_three_balls_support():
    """Beyond the common velocity, the sector reaches sqrt(2/3) between its edges, and nothing behind them."""
    S = launched(3, 1).admissible_set
    edges = np.array([[-2, 1, 1], [-1, -1, 2]]) / np.sqrt(6)
    middle = edges.sum(axis=0) / np.sqrt(3)
    for direction, reach in [(edges[0], 1), (edges[1], 1), (middle, 1), (-middle, 0), (edges[0] - edges[1], 1 / 2)]:
        assert S.support(direction) == pytest.approx(np.sqrt(2 / 3) * reach, abs=1e-12)
    assert S.support([1, 1, 1]) == pytest.approx(1, abs=1e-12)
    assert S.support([0, 0, 0]) == 0
    assert S.support(-5 * middle + 7) == pytest.approx(7, abs=1e-12)


def test_three_balls_samples_fill_the_sector():
    """Uniform on the sector of radius sqrt(2/3): angle and squared radius are uniform; its area is pi/9."""
    S = launched(3, 1).admissible_set
    v = S.sample(20_000, 1)
    assert all(map(S.contains, v[:500]))
    assert v.min(axis=0) @ [0, 1, 0] >= -1e-12
    np.testing.assert_allclose(v.sum(axis=1), 1, atol=1e-12)
    edge = np.array([-2, 1, 1]) / np.sqrt(6)
    across = np.array([0, -1, 1]) / np.sqrt(2)
    angle = np.arctan2(v @ across, v @ edge)
    radius_squared = np.sum((v - 1 / 3) ** 2, axis=1)
    assert kstest(angle / (np.pi / 3), "uniform").pvalue > UNIFORM
    assert kstest(radius_squared / (2 / 3), "uniform").pvalue > UNIFORM
    assert abs(np.corrcoef(angle, radius_squared)[0, 1]) < 4 / np.sqrt(len(v))
    # the triangle of the three corners, of area sqrt(3)/6, holds its part of the samples
    inside = np.mean(np.cos(angle - np.pi / 6) * np.sqrt(radius_squared) <= np.cos(np.pi / 6) * np.sqrt(2 / 3))
    part = np.sqrt(3) / 6 / (np.pi / 9)
    assert inside == pytest.approx(part, abs=4 * np.sqrt(part * (1 - part) / len(v)))


# --- other exact sets ----------------------------------------------------------------------------------------------


def test_one_contact_is_the_segment_from_plastic_to_elastic():
    c = Collision([[4.0]], [[-2.0]], [3.0])
    S = c.admissible_set
    assert S.intensity_range() == pytest.approx((6, 12))
    assert S.project([5]) == pytest.approx([0])
    assert S.project([-7]) == pytest.approx([-3])
    assert S.project([-1.25]) == pytest.approx([-1.25])
    assert S.distance([5]) == pytest.approx(10)
    assert S.support([1]) == pytest.approx(0, abs=1e-12)
    assert S.support([-2]) == pytest.approx(24)
    assert kstest(-S.sample(5000, 2)[:, 0] / 3, "uniform").pvalue > UNIFORM


def test_opposing_walls_leave_a_segment():
    S = corner().admissible_set
    v = S.sample(5000, 3)
    assert np.abs(v[:, 0]).max() < 1e-12
    assert kstest(v[:, 1] / np.sqrt(2), "uniform").pvalue > UNIFORM
    np.testing.assert_allclose(S.project([0.3, 5.0]), [0, np.sqrt(2)], atol=1e-12)
    np.testing.assert_allclose(S.project([-4.0, 0.5]), [0, 0.5], atol=1e-12)
    assert S.support([9, 1]) == pytest.approx(np.sqrt(2), abs=1e-12)
    assert S.support([9, -1]) == pytest.approx(0, abs=1e-12)
    assert not S.contains([1e-6, 0.5])


def test_walls_alone_leave_a_point():
    S = Collision([[2.0]], [[1.0], [-3.0]], [-1.0]).admissible_set
    np.testing.assert_allclose(S.sample(3, 0), 0, atol=1e-12)
    assert S.intensity_range() == pytest.approx((np.sqrt(2), np.sqrt(2)))
    assert S.support([1.0]) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", ["all separating", "zero velocity", "no contact"])
def test_nothing_approaches(name):
    c = PROBLEMS[name]()
    S = c.admissible_set
    np.testing.assert_array_equal(S.sample(4, 0), np.tile(c.pre_velocity, (4, 1)))
    np.testing.assert_array_equal(S.project(c.pre_velocity + 1), c.pre_velocity)
    u = np.arange(1.0, 1 + len(c.pre_velocity))
    assert S.support(u) == pytest.approx(u @ c.mass_matrix @ c.pre_velocity)
    assert S.intensity_range() == (0, 0)
    assert S.contains(c.pre_velocity)
    assert not S.contains(c.pre_velocity + 1e-6)
    assert S.distance(c.pre_velocity + 1) == pytest.approx(c.metric.norm(np.ones_like(c.pre_velocity)))


def _box_set(c, v):
    """S of a cube on its four corners in closed form: forces on a square carry |torque| <= force about each axis."""
    fz, tx, ty = (v - c.pre_velocity)[:, 2:5].T * c.mass_matrix.diagonal()[2:5, None]
    kinetic = (np.abs(tx) <= fz) & (np.abs(ty) <= fz)
    kinematic = v[:, 2] >= np.abs(v[:, 3]) + np.abs(v[:, 4])
    return kinetic & kinematic & (v**2 @ c.mass_matrix.diagonal() <= c.pre_speed**2)


@pytest.mark.parametrize(("tilt", "inertia"), [(0.0, 4 / 3), (0.4, 4 / 3), (0.1, 12.0)])
def test_box_on_four_corners(tilt, inertia):
    """Redundant contacts of rank 3: samples are distributed like those that rejection keeps of a cube around S."""
    c = box(tilt=tilt)
    c = Collision(np.diag([2.0] * 3 + [inertia] * 3), c.jacobian, c.pre_velocity)
    S, rng = c.admissible_set, np.random.default_rng(4)
    v = S.sample(3000, rng)
    assert all(map(S.contains, v[:200]))
    np.testing.assert_allclose(v[:, [0, 1, 5]], np.tile(c.pre_velocity[[0, 1, 5]], (3000, 1)), atol=1e-14)
    trial = np.tile(c.pre_velocity, (200_000, 1))
    trial[:, 2:5] = rng.uniform(-1, 1, (200_000, 3)) * c.pre_speed / np.sqrt(c.mass_matrix.diagonal()[2:5])
    kept = trial[_box_set(c, trial)]
    assert len(kept) > 2000
    for direction in np.vstack([np.eye(6)[2:5], rng.normal(size=(3, 6))]):
        assert ks_2samp(v @ direction, kept @ direction).pvalue > UNIFORM
    for velocity, inside in zip(trial[:500], _box_set(c, trial[:500]), strict=True):
        assert S.contains(velocity) == inside


def test_independent_contacts_are_an_orthant_of_the_ball():
    """Eight particles on eight floors: radius^8 is uniform, and the squares on the sphere are Beta(1/2, 7/2)."""
    c = Collision(np.diag(10.0 ** np.arange(-4, 4)), np.eye(8), -np.ones(8))
    z = c.metric.whiten(c.admissible_set.sample(4000, 5)) / c.pre_speed
    assert (z >= -1e-12).all()
    radius_squared = np.sum(z**2, axis=1)
    assert kstest(radius_squared**4, "uniform").pvalue > UNIFORM
    for i in range(8):
        assert kstest(z[:, i] ** 2 / radius_squared, "beta", (0.5, 3.5)).pvalue > UNIFORM


# --- intensity -----------------------------------------------------------------------------------------------------


def test_separating_contact_cuts_the_intensity():
    """Where 2 p - v- would penetrate, the largest intensity is smaller: (0, sqrt 2) and (1, 0) are the farthest."""
    assert corner().admissible_set.intensity_range() == pytest.approx((np.sqrt(2), np.hypot(1, 1 + np.sqrt(2))))
    assert narrow_wedge().admissible_set.intensity_range() == pytest.approx((np.sin(np.deg2rad(50)), 1))
    c = balls([1, 1, 1], [1, 0, 0.3])
    least, largest = c.admissible_set.intensity_range()
    assert not c.admissible_set.contains(Moreau(1.0).resolve(c).post_velocity)
    assert largest < 2 * least - 0.01


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


# --- projection and support ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SMALL)
def test_samples_projections_and_support_agree(name):
    """Projections are members with ``<v - p, s - p> <= 0`` for every s in S; support is no less than any sample."""
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
            # p is where S reaches farthest towards v
            assert S.support(v - p) == pytest.approx(gap @ c.metric.whiten(p), abs=tol * distance)
        u = c.metric.whiten(v)
        assert (s @ u).max() <= S.support(v) + tol * np.linalg.norm(u)
        assert S.support(3 * v) == pytest.approx(3 * S.support(v), abs=tol * np.linalg.norm(u))


def _by_slsqp(c, v):
    """The nearest member of S, over the impulses."""
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
        outside = max(c.metric.norm(other) - c.pre_speed, 0.0) + penetration  # the optimiser's own violation
        assert c.metric.norm(v - p) == pytest.approx(distance, abs=1e-9 * distance + outside)
        assert c.metric.norm(p - other) <= 1e-5 * c.pre_speed  # the distance has twice the digits of the point


def test_grazing_is_as_exact_as_rounding_allows():
    """S shrinks with the closing speed: at 1e-8 of |v-|, it is still the sector, to 1e-16 of |v-|."""
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
    """64 contacts in a row; five boxes on four corners each, whose cone has 4 facets per box and not 4^5."""
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


# --- any collision -------------------------------------------------------------------------------------------------


@st.composite
def collisions(draw):
    """Up to 6 contacts of up to 5 velocities with small integers, so that gradients often depend on each other."""
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
    """Maximal dissipation always, Moreau where no contact separates before the impact."""
    outcomes = [MaximalDissipation().resolve(c).post_velocity]
    if (c.pre_contact_velocity <= 0).all():
        outcomes.append(Moreau(e).resolve(c).post_velocity)
    for v in outcomes:
        assert c.admissible_set.contains(v)
        assert c.admissible_set.distance(v) <= 1e-9 * c.pre_speed


# --- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["contains", "distance", "project", "support"])
@pytest.mark.parametrize("value", [[1.0, 2.0], [[1.0, 2.0, 3.0]], [1.0, np.nan, 0.0], [np.inf, 0.0, 0.0], 1.0])
def test_not_a_velocity(method, value):
    with pytest.raises(InvalidCollisionError, match="must be finite with shape"):
        getattr(AdmissibleSet(launched(3, 1)), method)(value)


def test_number_of_samples():
    S = launched(3, 1).admissible_set
    assert S.sample(0, 0).shape == (0, 3)
    with pytest.raises(InvalidCollisionError, match="0 or more"):
        S.sample(-1, 0)
    np.testing.assert_array_equal(S.sample(2, 7), S.sample(2, np.random.default_rng(7)))


def test_too_many_facets():
    rng = np.random.default_rng(11)
    c = Collision(np.eye(20), rng.normal(size=(60, 20)), rng.normal(size=20))
    with pytest.raises(EnumerationError, match="60 contacts depend on each other with rank 20"):
        c.admissible_set.project(np.zeros(20))
    assert c.admissible_set.contains(MaximalDissipation().resolve(c).post_velocity)


def test_too_many_faces():
    """Fourteen contacts, some of them separating: only the largest intensity is refused."""
    rng = np.random.default_rng(0)
    S = Collision(np.eye(14), rng.normal(size=(14, 14)), rng.normal(size=14)).admissible_set
    assert S.contains(S.project(np.ones(14)))
    with pytest.raises(EnumerationError, match="faces"):
        S.intensity_range()


def test_gradients_that_depend_on_each_other_but_for_rounding():
    c = Collision(np.eye(2), [[1, 3e-11], [-1, 3e-11]], [0.3, -1])
    with pytest.raises(SolverError, match="lost to rounding"):
        c.admissible_set.project([0, 0])
    assert issubclass(SolverError, ImpactLawError)
