"""A collision: its quantities, the kinetic metric, and invalid arguments."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from problems import PROBLEMS, launched, random_collision, spd

from impactlaw import Collision, Friction, ImpactLawError
from impactlaw.errors import InvalidCollisionError
from impactlaw.mechanics.kinetic_metric import KineticMetric


@pytest.mark.parametrize("problem_name", PROBLEMS)
def test_quantities(problem_name):
    c = PROBLEMS[problem_name]()
    M, J, v = c.mass_matrix, c.jacobian, c.pre_velocity
    G = J @ np.linalg.solve(M, J.T)
    np.testing.assert_allclose(c.delassus, G, rtol=1e-9, atol=1e-12 * np.abs(G).max(initial=0.0))
    np.testing.assert_allclose(c.whitened_jacobian @ c.whitened_jacobian.T, c.delassus)
    np.testing.assert_allclose(c.gradient_norms, np.sqrt(np.diag(G)), rtol=1e-9)
    np.testing.assert_array_equal(c.pre_contact_velocity, J @ v)
    np.testing.assert_allclose(c.whitened_jacobian @ c.whitened_velocity, J @ v, rtol=1e-9, atol=1e-9)
    assert c.kinetic_energy == pytest.approx(0.5 * v @ M @ v, rel=1e-12)
    assert c.pre_speed == pytest.approx(np.sqrt(v @ M @ v), rel=1e-12)
    assert len(c.labels) == len(J)


def test_delassus_of_equal_balls():
    np.testing.assert_array_equal(launched(4, 1).delassus, [[2, -1, 0], [-1, 2, -1], [0, -1, 2]])


def test_inputs_are_copied_and_frozen():
    M, J, v = np.eye(2), np.ones((1, 2)), np.array([-1.0, 0.0])
    c = Collision(M, J, v)
    M[0, 0], J[0, 0], v[0] = 9.0, 9.0, 9.0
    np.testing.assert_array_equal(c.mass_matrix, np.eye(2))
    np.testing.assert_array_equal(c.jacobian, [[1, 1]])
    np.testing.assert_array_equal(c.pre_velocity, [-1, 0])
    for array in (c.mass_matrix, c.jacobian, c.pre_velocity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(AttributeError):
        c.pre_velocity = v  # pyright: ignore[reportAttributeAccessIssue]


def test_lists_and_integers_will_do():
    c = Collision([[2, 0], [0, 1]], [[1, 1]], [-1, 0])
    assert c.jacobian.dtype == float
    assert c.kinetic_energy == pytest.approx(1.0, rel=1e-15)


def test_labels():
    assert launched(3, 1).labels == ("0", "1")
    assert Collision(np.eye(2), np.eye(2), [0, 0], labels=["a/b", "b/c"]).labels == ("a/b", "b/c")


@pytest.mark.parametrize("labels", ["ab", (1, 2), ("a/b", None), 5])
def test_labels_are_texts(labels):
    """Messages join them; the letters of one text are not labels."""
    with pytest.raises(InvalidCollisionError, match="labels are texts, one for each contact"):
        Collision(np.eye(2), np.eye(2), [0, 0], labels=labels)


def test_a_metric_that_the_caller_has_is_used():
    metric = KineticMetric(np.diag([4.0, 9.0]))
    c = Collision(metric.mass_matrix, np.eye(2), [1.0, 1.0], metric=metric)
    assert c.metric is metric
    np.testing.assert_allclose(c.whitened_velocity, [2.0, 3.0])


def test_admissible_set_is_that_of_the_collision():
    c = launched(3, 1)
    assert c.admissible_set.collision is c


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones((2, 3)), [[1.0, 1.0]], [1.0, 1.0]), r"mass_matrix must be square and not empty, got shape \(2, 3\)"),
        ((np.ones(2), [[1.0, 1.0]], [1.0, 1.0]), r"mass_matrix must be square and not empty, got shape \(2,\)"),
        ((np.zeros((0, 0)), np.zeros((0, 0)), []), r"mass_matrix must be square and not empty"),
        (([["x"]], [[1.0]], [1.0]), "mass_matrix is not an array of numbers"),
        (([[1.0, 0.0], [1.0]], [[1.0]], [1.0]), "mass_matrix is not an array of numbers"),
        (([[1.0, np.nan], [np.nan, 1.0]], [[1.0, 1.0]], [1.0, 1.0]), "mass_matrix has entries that are not finite"),
        (([[np.inf]], [[1.0]], [1.0]), "mass_matrix has entries that are not finite"),
        (([[2.0, 1.0], [0.5, 2.0]], [[1.0, 1.0]], [1.0, 1.0]), r"not symmetric: \(0, 1\) and its mirror differ by 0.5"),
        (([[1.0, 2.0], [2.0, 1.0]], [[1.0, 1.0]], [1.0, 1.0]), "mass_matrix is not positive definite"),
        (([[1.0, 0.0], [0.0, 0.0]], [[1.0, 1.0]], [1.0, 1.0]), r"not positive definite: entry \(1, 1\) is 0.0"),
        (([[1.0, 0.0], [0.0, -3.0]], [[1.0, 1.0]], [1.0, 1.0]), r"not positive definite: entry \(1, 1\) is -3.0"),
        (([[1.0, 1.0], [1.0, 1.0]], [[1.0, 1.0]], [1.0, 1.0]), "mass_matrix is not positive definite"),
        ((np.eye(2), [[1.0]], [1.0, 1.0]), r"jacobian must have shape \(h, 2\) like mass_matrix, got \(1, 1\)"),
        ((np.eye(2), [1.0, 1.0], [1.0, 1.0]), r"jacobian must have shape \(h, 2\) like mass_matrix, got \(2,\)"),
        ((np.eye(2), [[1.0, np.nan]], [1.0, 1.0]), "jacobian has entries that are not finite"),
        ((np.eye(2), [["a", "b"]], [1.0, 1.0]), "jacobian is not an array of numbers"),
        ((np.eye(2), [[1.0, 1.0]], [1.0]), r"pre_velocity must have shape \(2,\) like mass_matrix, got \(1,\)"),
        ((np.eye(2), [[1.0, 1.0]], [[1.0], [1.0]]), r"pre_velocity must have shape \(2,\)"),
        ((np.eye(2), [[1.0, 1.0]], [1.0, -np.inf]), "pre_velocity has entries that are not finite"),
        ((np.eye(2), [[1.0, 1.0]], None), "pre_velocity"),
        ((np.eye(2) * (1 + 1j), [[1.0, 1.0]], [1.0, 1.0]), "mass_matrix is not an array of numbers: real numbers"),
        ((np.eye(2), np.array([[1.0, 1j]]), [1.0, 1.0]), "jacobian is not an array of numbers: real numbers"),
        ((np.eye(2), [[1.0, 1.0]], [1.0, np.complex128(1j)]), "pre_velocity is not an array of numbers: real numbers"),
        ((np.eye(2), scipy.sparse.csr_array([[1.0, 1j]]), [1.0, 1.0]), "jacobian is not a matrix of numbers: real"),
    ],
)
def test_what_is_not_a_collision(arguments, message):
    with pytest.raises(InvalidCollisionError, match=message) as caught:
        Collision(*arguments)
    assert isinstance(caught.value, ImpactLawError)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("labels", [("a",), ("a", "b", "c")])
def test_as_many_labels_as_contacts(labels):
    with pytest.raises(InvalidCollisionError, match=f"{len(labels)} labels for 2 contacts"):
        Collision(np.eye(2), np.eye(2), [0.0, 0.0], labels=labels)


def test_rounding_is_not_asymmetry():
    M = spd(np.random.default_rng(0), 5, 1e3)
    M[0, 1] *= 1 + 1e-14
    assert Collision(M, np.ones((1, 5)), np.ones(5)).kinetic_energy > 0


@pytest.mark.parametrize("condition", [1e0, 1e6, 1e12])
@pytest.mark.parametrize("diagonal", [True, False])
def test_metric(condition, diagonal):
    rng = np.random.default_rng(7)
    M = np.diag(np.geomspace(condition**-0.5, condition**0.5, 6)) if diagonal else spd(rng, 6, condition)
    metric = KineticMetric(M)
    v, J = rng.normal(size=(3, 6)), rng.normal(size=(4, 6))
    norms = np.sqrt(np.einsum("ni,ij,nj->n", v, M, v))
    rounding = 1e-14 * np.sqrt(condition)
    np.testing.assert_allclose(np.linalg.norm(metric.whiten(v), axis=1), norms, rtol=1e-9)
    assert metric.norm(v[0]) == pytest.approx(norms[0], rel=1e-9)
    np.testing.assert_allclose(metric.unwhiten(metric.whiten(v)), v, rtol=0, atol=100 * rounding)
    np.testing.assert_allclose(metric.unwhiten(metric.whiten(v[0])), v[0], rtol=0, atol=100 * rounding)
    np.testing.assert_allclose(metric.whiten_gradients(J) @ metric.whiten(v).T, J @ v.T, rtol=0, atol=1000 * rounding)
    Y = metric.whiten_gradients(J)
    np.testing.assert_allclose(metric.unwhiten(Y), np.linalg.solve(M, J.T).T, rtol=1e-13 * condition + 1e-12)


def test_random_collisions_reach_the_extremes_they_are_meant_to():
    """Checks the ranges of the generator of the property tests, so that these cannot lose them unnoticed."""
    seen = [random_collision(np.random.default_rng([0, i])) for i in range(500)]
    assert max(len(c.labels) for c in seen) == 64
    assert max(np.linalg.cond(c.mass_matrix) for c in seen) > 1e11
    assert max(np.ptp(np.log10(np.diag(c.mass_matrix))) for c in seen) > 11
    assert max(np.ptp(np.log10(c.gradient_norms[c.gradient_norms > 0])) for c in seen) > 6
    assert sum(np.linalg.matrix_rank(c.jacobian) < len(c.labels) for c in seen) > 100
    assert sum((c.pre_contact_velocity < 0).all() for c in seen) > 50


def test_attributes_are_computed_once():
    c = launched(3, 1)
    assert c.delassus is c.delassus
    assert (type(c).delassus.__doc__ or "").startswith("``G = Y Y^T``")


def test_a_metric_of_another_mass_matrix_is_not_taken():
    collision = Collision(np.eye(1), [[1.0]], [-1.0])
    assert replace(collision, mass_matrix=[[100.0]]).kinetic_energy == pytest.approx(50.0)
    assert replace(collision, pre_velocity=[-2.0]).metric is collision.metric


def test_friction_keeps_a_copy_of_what_it_is_given():
    contact = np.array([0, 0])
    friction = Friction(np.eye(2), contact, [1.0, 1.0])
    contact[:] = 5
    assert friction.contact.tolist() == [0, 0]


def test_contact_velocities_cannot_be_written_to():
    c = Collision(np.eye(2), [[0.0, 1.0]], [1.0, -1.0], friction=Friction([[1.0, 0.0]], [0], [0.5]))
    for values in (c.pre_contact_velocity, c.pre_sliding_velocity):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0.0
