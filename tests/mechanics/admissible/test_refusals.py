"""What the admissible set refuses: invalid points, invalid counts, sets too large to enumerate."""

import numpy as np
import pytest
from problems import launched

from impactlaw import AdmissibleSet, Collision, ImpactLawError, MaximalDissipation
from impactlaw.errors import InvalidCollisionError, SolverError
from impactlaw.mechanics.admissible.cone import EnumerationError


@pytest.mark.parametrize("method", ["contains", "distance", "project", "support"])
@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([1.0, 2.0], r"must have shape \(3,\) like pre_velocity, got \(2,\)"),
        ([[1.0, 2.0, 3.0]], r"must have shape \(3,\) like pre_velocity, got \(1, 3\)"),
        ([1.0, np.nan, 0.0], "has entries that are not finite"),
        ([np.inf, 0.0, 0.0], "has entries that are not finite"),
        (1.0, r"must have shape \(3,\) like pre_velocity, got \(\)"),
        ("abc", "is not an array of numbers"),
        ([[1], [1, 2]], "is not an array of numbers"),
    ],
)
def test_not_a_velocity(method, value, message):
    with pytest.raises(InvalidCollisionError, match=f"(v|direction) {message}"):
        getattr(AdmissibleSet(launched(3, 1)), method)(value)


def test_no_collision_and_no_tolerance():
    with pytest.raises(InvalidCollisionError, match=r"S\(v-\) is that of a Collision, got None"):
        AdmissibleSet(None)
    with pytest.raises(InvalidCollisionError, match="tol must be a number"):
        launched(3, 1).admissible_set.contains([0.0, 0.0, 1.0], tol="x")


def test_number_of_samples():
    S = launched(3, 1).admissible_set
    assert S.sample(0, 0).shape == (0, 3)
    for n in (-1, 1.5, "a"):
        with pytest.raises(InvalidCollisionError, match="0 or more"):
            S.sample(n, 0)
    np.testing.assert_array_equal(S.sample(2, 7), S.sample(2, np.random.default_rng(7)))


def test_too_many_facets():
    rng = np.random.default_rng(11)
    c = Collision(np.eye(20), rng.normal(size=(60, 20)), rng.normal(size=20))
    with pytest.raises(EnumerationError, match="60 contacts depend on each other with rank 20"):
        c.admissible_set.project(np.zeros(20))
    assert c.admissible_set.contains(MaximalDissipation().resolve(c).post_velocity)


def test_too_many_faces():
    """With fourteen contacts, some of them separating, only the largest intensity is refused."""
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
