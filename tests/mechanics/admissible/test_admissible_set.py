"""The set of possible right-velocities S(v-) against exactly known sets."""

import numpy as np
import pytest
from problems import PROBLEMS, balls, box, launched
from scipy.stats import ks_2samp, kstest

from impactlaw import Collision, Moreau
from impactlaw.errors import InvalidCollisionError

UNIFORM = 1e-3  # smallest p-value of Kolmogorov's test; the seeds are fixed


def corner():
    """Return a particle between walls at x = 0 that falls on a floor at 45 degrees: S is x = 0, 0 <= y <= sqrt 2."""
    return Collision(np.eye(2), [[1, 0], [-1, 0], [0, 1]], [-1, -1])


def narrow_wedge():
    """Return a wedge of 10 degrees, hit at 60 degrees: the elastic outcome would penetrate the other side."""
    a, v = np.deg2rad([10, 60])
    return Collision(np.eye(2), [[0, 1], [np.sin(a), -np.cos(a)]], [np.cos(v), np.sin(v)])


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
    """From the common velocity, the sector reaches sqrt(2/3) in directions between its edges, and 0 behind them."""
    S = launched(3, 1).admissible_set
    edges = np.array([[-2, 1, 1], [-1, -1, 2]]) / np.sqrt(6)
    middle = edges.sum(axis=0) / np.sqrt(3)
    for direction, reach in [(edges[0], 1), (edges[1], 1), (middle, 1), (-middle, 0), (edges[0] - edges[1], 1 / 2)]:
        assert S.support(direction) == pytest.approx(np.sqrt(2 / 3) * reach, abs=1e-12)
    assert S.support([1, 1, 1]) == pytest.approx(1, abs=1e-12)
    assert S.support([0, 0, 0]) == 0
    assert S.support(-5 * middle + 7) == pytest.approx(7, abs=1e-12)


def test_three_balls_samples_fill_the_sector():
    """Samples are uniform on the sector of radius sqrt(2/3): angle and squared radius are uniform; its area is pi/9."""
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
    # the triangle of the three corners, of area sqrt(3)/6, contains its share of the samples
    inside = np.mean(np.cos(angle - np.pi / 6) * np.sqrt(radius_squared) <= np.cos(np.pi / 6) * np.sqrt(2 / 3))
    part = np.sqrt(3) / 6 / (np.pi / 9)
    assert inside == pytest.approx(part, abs=4 * np.sqrt(part * (1 - part) / len(v)))


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
    """Return S of a cube on four corners in closed form: forces on a square carry |torque| <= force about each axis."""
    fz, tx, ty = (v - c.pre_velocity)[:, 2:5].T * c.mass_matrix.diagonal()[2:5, None]
    kinetic = (np.abs(tx) <= fz) & (np.abs(ty) <= fz)
    kinematic = v[:, 2] >= np.abs(v[:, 3]) + np.abs(v[:, 4])
    return kinetic & kinematic & (v**2 @ c.mass_matrix.diagonal() <= c.pre_speed**2)


@pytest.mark.parametrize(("tilt", "inertia"), [(0.0, 4 / 3), (0.4, 4 / 3), (0.1, 12.0)])
def test_box_on_four_corners(tilt, inertia):
    """Redundant contacts of rank 3: samples are distributed as by rejection sampling from a cube around S."""
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


def test_separating_contact_cuts_the_intensity():
    """Where 2 p - v- would penetrate, the largest intensity is smaller; (0, sqrt 2) and (1, 0) are farthest."""
    assert corner().admissible_set.intensity_range() == pytest.approx((np.sqrt(2), np.hypot(1, 1 + np.sqrt(2))))
    assert narrow_wedge().admissible_set.intensity_range() == pytest.approx((np.sin(np.deg2rad(50)), 1))
    c = balls([1, 1, 1], [1, 0, 0.3])
    least, largest = c.admissible_set.intensity_range()
    assert not c.admissible_set.contains(Moreau(1.0).resolve(c).post_velocity)
    assert largest < 2 * least - 0.01


@pytest.mark.parametrize("rng", ["x", -1, 1.5, object()], ids=["text", "negative", "half", "object"])
def test_a_generator_that_is_none(rng):
    with pytest.raises(InvalidCollisionError, match="rng is a numpy generator"):
        launched(3, 1).admissible_set.sample(3, rng)
