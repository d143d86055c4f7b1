"""Collisions with a sparse mass matrix or Jacobian: the same quantities as with arrays, and what is refused."""

import numpy as np
import pytest
import scipy.sparse as sp
from problems import balls, launched, random_collision, sparse_chain, spd

from impactlaw import Collision, Fremond, Impact, MaximalDissipation, Moreau, energy_gain
from impactlaw.errors import InvalidCollisionError, SolverError, UnsolvableLawError
from impactlaw.mechanics.block_metric import LARGEST_BLOCK, SparseMetric
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.solvers import Problem, solve_with_jump


def first_launched(n: int) -> np.ndarray:
    return (np.arange(n) == 0).astype(float)


def test_large_arrays_of_mostly_zeros_take_the_sparse_way():
    c = launched(201, 3)
    problem = Problem(c.whitened_jacobian, -1.5 * c.pre_contact_velocity, -1.5 * c.whitened_velocity)
    answer = solve_with_jump(problem, c.labels)
    np.testing.assert_allclose(
        answer.jump, Moreau(0.5).resolve(c, solver="nnls").post_velocity - c.pre_velocity, atol=1e-12
    )


def test_unsolvable_sparse_law_names_the_contacts():
    J = sp.csr_array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    c = Collision(sp.eye_array(2), J, [1.0, -1.0])
    with pytest.raises(UnsolvableLawError, match="contacts 0, 1 ask"):
        Fremond(sp.csr_array(np.array([[-3.0, 0, 0], [0, 0.5, 0], [0, 0, 0]]))).resolve(c)


def test_redundant_contacts_of_a_sparse_scene_share():
    """Two boxes far apart, each on four corners."""
    corners = np.array([[1.0, x, y] for x in (-1, 1) for y in (-1, 1)])
    c = Collision(sp.eye_array(6), sp.block_diag([sp.coo_array(corners), corners]), [-1.0, 0, 0, -2.0, 0, 0])
    np.testing.assert_allclose(MaximalDissipation().resolve(c).impulse, [0.25] * 4 + [0.5] * 4, rtol=1e-12)


def test_dense_solver_on_a_sparse_problem():
    c = sparse_chain(np.ones(20), first_launched(20))
    np.testing.assert_allclose(
        Moreau(0.5).resolve(c, solver="nnls").post_velocity, Moreau(0.5).resolve(c).post_velocity, atol=1e-12
    )
    with pytest.raises(SolverError, match="solver 'nnls' reached no answer on 9999 contacts"):
        Moreau(0.5).resolve(sparse_chain(np.ones(10000), first_launched(10000)), solver="nnls")


@pytest.mark.parametrize("seed", range(20))
def test_quantities_are_those_of_arrays(seed):
    rng = np.random.default_rng([49, seed])
    blocks = [spd(rng, int(size), 1e3) for size in rng.choice([1, 2, 3, 6], size=5)]
    shuffle = rng.permutation(sum(map(len, blocks)))
    M = sp.block_diag([sp.coo_array(block) for block in blocks]).toarray()[np.ix_(shuffle, shuffle)]
    J = rng.normal(size=(7, len(M))) * (rng.random((7, len(M))) < 0.5)
    v = rng.normal(size=len(M))
    sparse, dense = Collision(sp.coo_matrix(M), sp.csc_matrix(J), v), Collision(M, J, v)
    np.testing.assert_allclose(sparse.delassus.toarray(), dense.delassus, atol=1e-10)
    np.testing.assert_allclose(sparse.gradient_norms, dense.gradient_norms, rtol=1e-10)
    np.testing.assert_allclose(sparse.pre_contact_velocity, dense.pre_contact_velocity, atol=1e-13)
    assert sparse.kinetic_energy == pytest.approx(dense.kinetic_energy, rel=1e-12)
    one, other = Moreau(0.3).resolve(sparse), Moreau(0.3).resolve(dense)
    for name in ("post_velocity", "impulse", "topology", "induced_gradient", "mean_contact_velocity"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9)
    for name in ("intensity", "induced_impulse", "energy_change"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-9)
    assert one.violations.is_admissible() == other.violations.is_admissible()
    observed = Impact.observed(sparse, other.post_velocity)
    np.testing.assert_allclose(observed.impulse, other.impulse, atol=1e-8)


@pytest.mark.parametrize("M", [np.diag([1.0, 4.0, 9.0]), np.array([[2.0, 0.5, 0], [0.5, 1.0, 0], [0, 0, 3.0]])])
def test_sparse_metric(M):
    sparse, dense = SparseMetric(sp.csr_array(M)), KineticMetric(M)
    v = np.array([[1.0, -2.0, 3.0], [0.5, 0.0, 1.0]])
    np.testing.assert_allclose(sparse.whiten(v), dense.whiten(v), rtol=1e-14)
    np.testing.assert_allclose(sparse.unwhiten(sparse.whiten(v[0])), v[0], rtol=1e-14)
    np.testing.assert_allclose(
        sparse.whiten_gradients(sp.csr_array(v)).toarray(), dense.whiten_gradients(v), rtol=1e-14
    )
    assert sparse.norm(v[0]) == pytest.approx(dense.norm(v[0]), rel=1e-14)


def chain_of_couplings(n: int) -> sp.csr_array:
    return sp.csr_array(sp.diags_array([np.full(n, 3.0), np.ones(n - 1), np.ones(n - 1)], offsets=[0, 1, -1]))


@pytest.mark.parametrize(
    ("M", "J", "message"),
    [
        (sp.csr_array((2, 3)), [[1.0, 0.0]], "mass_matrix must be square and not empty"),
        (sp.csr_array([[1.0, 2.0], [2.0, 1.0]]), [[1.0, 0.0]], "not positive definite"),
        (sp.csr_array([[1.0, 0.0], [0.0, 0.0]]), [[1.0, 0.0]], r"entry \(1, 1\) is 0.0"),
        (sp.csr_array([[2.0, 1.0], [0.5, 2.0]]), [[1.0, 0.0]], r"not symmetric: \((0, 1|1, 0)\)"),
        (sp.csr_array([[np.nan, 0.0], [0.0, 1.0]]), [[1.0, 0.0]], "mass_matrix has entries that are not finite"),
        (sp.eye_array(2), sp.csr_array([[np.inf, 0.0]]), "jacobian has entries that are not finite"),
        (sp.eye_array(2), sp.csr_array([[1.0]]), r"jacobian must have shape \(h, 2\)"),
        (chain_of_couplings(LARGEST_BLOCK + 1), np.ones((1, LARGEST_BLOCK + 1)), "pass it as a dense array"),
    ],
)
def test_what_is_not_a_sparse_collision(M, J, message):
    with pytest.raises(InvalidCollisionError, match=message):
        Collision(M, J, np.ones(np.shape(J)[1] if not sp.issparse(J) else 2))


def test_sparse_inputs_are_copied_and_frozen():
    J = sp.csr_array([[1.0, 2.0]])
    c = Collision(sp.eye_array(2), J, [-1.0, 0.0])
    J.data[0] = 9.0
    assert c.jacobian.toarray().tolist() == [[1.0, 2.0]]
    with pytest.raises(ValueError, match="read-only"):
        c.jacobian.data[0] = 0.0
    part = J.data.view()
    part.flags.writeable = False
    other = Collision(sp.eye_array(2), sp.csr_array((part, J.indices, J.indptr)), [-1.0, 0.0])
    J.data[0] = 7.0
    assert other.jacobian.toarray().tolist() == [[9.0, 2.0]]


def test_one_of_the_two_sparse_is_enough():
    dense = balls([1.0, 2.0, 3.0], [1.0, 0.0, 0.0])
    for M, J in ((sp.csr_array(dense.mass_matrix), dense.jacobian), (dense.mass_matrix, sp.csr_array(dense.jacobian))):
        impact = Moreau(0.5).resolve(Collision(M, J, dense.pre_velocity))
        np.testing.assert_allclose(impact.post_velocity, Moreau(0.5).resolve(dense).post_velocity, rtol=1e-13)


@pytest.mark.parametrize("seed", range(30))
def test_any_collision_as_a_sparse_one(seed):
    c = random_collision(np.random.default_rng([50, seed]), most=20)
    law = Moreau(0.5)
    impact = law.resolve(Collision(sp.csr_array(c.mass_matrix), sp.csr_array(c.jacobian), c.pre_velocity))
    assert impact.residual < 1e-9


def test_the_admissible_set_of_a_sparse_collision_is_that_of_the_dense_one():
    rng = np.random.default_rng(7)
    J = np.diff(np.eye(4), axis=0)
    dense = Collision(np.eye(4), J, [1.0, 0.5, 0.0, -0.2])
    sparse = Collision(sp.csr_array(np.eye(4)), sp.csr_array(J), [1.0, 0.5, 0.0, -0.2])
    for _ in range(5):
        v = rng.normal(size=4)
        one, other = dense.admissible_set, sparse.admissible_set
        np.testing.assert_allclose(one.project(v), other.project(v), atol=1e-12)
        assert one.distance(v) == pytest.approx(other.distance(v))
        assert one.support(v) == pytest.approx(other.support(v))
    assert dense.admissible_set.intensity_range() == pytest.approx(sparse.admissible_set.intensity_range())
    assert energy_gain(dense, 0.5 * np.eye(3)) == pytest.approx(energy_gain(sparse, 0.5 * np.eye(3)))


def test_an_admissible_set_too_large_for_arrays_is_refused():
    n = 4000
    J = sp.diags_array([-np.ones(n), np.ones(n)], offsets=[0, 1], shape=(n, n + 1)).tocsr()
    c = Collision(sp.eye_array(n + 1).tocsr(), J, np.r_[1.0, np.zeros(n)])
    assert c.admissible_set.contains(Moreau(0.5).resolve(c).post_velocity, 1e-9)
    with pytest.raises(InvalidCollisionError, match="too many"):
        c.admissible_set.project(np.zeros(n + 1))
