"""Chains and piles with sparse mass matrices and Jacobians: exact answers, and the same as with arrays."""

import numpy as np
import pytest
import scipy.sparse as sp
from problems import balls, disks, launched, random_collision, sparse_chain, spd

from impactlaw import Collision, Fremond, Impact, MaximalDissipation, Moreau, Newton, energy_gain
from impactlaw.errors import InvalidCollisionError, RestitutionError, SolverError, UnsolvableLawError
from impactlaw.mechanics.block_metric import LARGEST_BLOCK, SparseMetric
from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.solvers import SOLVERS, Problem, Status, solve_with_jump
from impactlaw.solvers.methods.banded_delassus import BandedDelassus


def first_launched(n: int) -> np.ndarray:
    return (np.arange(n) == 0).astype(float)


def assert_law(impact: Impact, target: np.ndarray, tol: float = 1e-10) -> None:
    """Momentum and complementarity, by sparse products alone; M diagonal."""
    c = impact.collision
    m = c.mass_matrix.diagonal()
    lengths = np.sqrt((c.jacobian.power(2) / m).sum(axis=1))
    speed = max(np.sqrt(m @ c.pre_velocity**2), np.sqrt(m @ impact.post_velocity**2))
    momentum = m * (impact.post_velocity - c.pre_velocity) - c.jacobian.T @ impact.impulse
    assert np.linalg.norm(momentum / np.sqrt(m)) <= tol * speed
    slack = (c.jacobian @ impact.post_velocity - target) / lengths
    assert np.abs(np.minimum(impact.impulse * lengths, slack)).max() <= tol * speed
    assert impact.residual <= tol


# --- exact answers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [3, 101, 1001, 10001])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_moreau_of_a_launched_ball(n, e):
    """v+ = (1 + e) p - e v-, p the common velocity 1/n; the impulse falls off linearly along the chain."""
    impact = Moreau(e).resolve(sparse_chain(np.ones(n), first_launched(n)))
    np.testing.assert_allclose(impact.post_velocity, (1 + e) / n - e * first_launched(n), rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.impulse, (1 + e) * np.arange(n - 1, 0, -1) / n, rtol=0, atol=1e-10)
    assert impact.residual < 1e-13


@pytest.mark.parametrize("n", [3, 1000, 10000])
def test_reversal_reverses(n):
    v = -(np.sort(np.random.default_rng(n).normal(size=n)) ** 3)
    v = np.sort(v)[::-1]
    impact = Fremond.reversal().resolve(sparse_chain(np.ones(n), v))
    np.testing.assert_allclose(impact.post_velocity, v[::-1], rtol=0, atol=1e-9)
    assert abs(impact.energy_change) < 1e-9 * impact.collision.kinetic_energy


def test_sparse_restitution_matrix():
    n = 2000
    E = sp.csr_array(np.fliplr(np.eye(n - 1)))
    impact = Fremond(E).resolve(sparse_chain(np.ones(n), first_launched(n)))
    np.testing.assert_allclose(impact.post_velocity, first_launched(n)[::-1], atol=1e-12)
    E = Fremond.reversal(0.5).restitution_matrix(impact.collision)
    assert sp.issparse(E)
    np.testing.assert_array_equal(E.toarray(), 0.5 * np.fliplr(np.eye(n - 1)))
    with pytest.raises(RestitutionError, match="must be square"):
        Fremond(sp.csr_array((2, 3)))
    with pytest.raises(RestitutionError, match="not finite"):
        Fremond(sp.csr_array([[np.nan]]))
    with pytest.raises(RestitutionError, match="1999 contacts collide"):
        Fremond(sp.csr_array((3, 3))).resolve(impact.collision)


def test_grounded_chain():
    """A chain whose last ball rests against a wall: all of the energy comes back under the elastic law."""
    n = 1000
    J = sp.diags_array([-np.ones(n), np.ones(n - 1)], offsets=[0, 1], shape=(n, n))
    c = Collision(sp.eye_array(n), J, first_launched(n))
    np.testing.assert_allclose(MaximalDissipation().resolve(c).post_velocity, np.zeros(n), atol=1e-12)
    impact = Moreau(1.0).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, -first_launched(n), atol=1e-12)
    np.testing.assert_allclose(impact.impulse, 2.0, rtol=1e-10)


# --- certified -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1000, 10000])
@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_random_chain(n, spread):
    """Masses over 0 and 6 orders of magnitude, random velocities: contacts that separate."""
    rng = np.random.default_rng([n, int(spread)])
    c = sparse_chain(10.0 ** rng.uniform(-spread / 2, spread / 2, n), rng.normal(size=n))
    e = rng.uniform(size=n - 1)
    for law, target in (
        (Moreau(0.5), -0.5 * c.pre_contact_velocity),
        (Newton(e.tolist()), -e * c.pre_contact_velocity),
        (Fremond.reversal(), -c.pre_contact_velocity[::-1]),
    ):
        impact = law.resolve(c)
        assert_law(impact, target)
        assert impact.impulse.any()
        assert impact.violations.kinetic < 1e-9 * c.pre_speed


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("compression", [0.0, 1.0])
def test_pile_of_disks(seed, compression):
    """Redundant contacts: G is singular where there are no holes. The velocity is that of NNLS on arrays."""
    rng = np.random.default_rng([seed, 7])
    c = disks(12, rng, holes=0.1 * (seed % 3), compression=compression)
    assert (c.jacobian.shape[0] > c.jacobian.shape[1]) or seed % 3
    law = Moreau(rng.uniform())
    impact = law.resolve(c)
    assert_law(impact, -law.restitution * c.pre_contact_velocity)
    dense = Collision(c.mass_matrix.toarray(), c.jacobian.toarray(), c.pre_velocity)
    np.testing.assert_allclose(
        impact.post_velocity, law.resolve(dense, solver="nnls").post_velocity, rtol=0, atol=1e-9 * c.pre_speed
    )


def test_pile_of_hundreds_of_redundant_contacts():
    c = disks(18, np.random.default_rng(1), holes=0.0, compression=0.0)
    assert c.jacobian.shape[0] > c.jacobian.shape[1]
    assert_law(Moreau(0.5).resolve(c), -0.5 * c.pre_contact_velocity)


@pytest.mark.parametrize("seed", range(10))
def test_primal_dual_agrees_with_nnls(seed):
    """100 problems each: any kind of gradients, sparse ones, dependent ones. An answer, or none, never a wrong one."""
    answered = 0
    for i in range(100):
        rng = np.random.default_rng([48, seed, i])
        h, nv = int(rng.integers(1, 40)), int(rng.integers(1, 40))
        Y = rng.normal(size=(h, nv)) * (rng.random((h, nv)) < rng.uniform(0.05, 1.0))
        Y[np.arange(h), rng.integers(0, nv, h)] += 1.0
        Y *= 10.0 ** rng.uniform(-2, 2, (h, 1))
        d = rng.normal(size=nv)
        reference = SOLVERS["nnls"](Problem(Y, Y @ d, d))
        for gradients in (Y, sp.csr_array(Y)):
            solution = SOLVERS["primal-dual-active-set"](Problem(gradients, Y @ d, d))
            if solution.status is Status.SOLVED:
                answered += 1
                np.testing.assert_allclose(
                    solution.impulse @ Y, reference.impulse @ Y, rtol=0, atol=1e-8 * np.linalg.norm(d)
                )
    assert answered > 190


@pytest.mark.parametrize("touching", [1, 2, 3, 20])
@pytest.mark.parametrize("shuffled", [False, True])
def test_banded_delassus_is_the_delassus_matrix_of_unit_gradients(touching, shuffled):
    """Contacts that share a degree of freedom with the ``touching - 1`` next ones; up to 8 and more than 8 of them."""
    rng = np.random.default_rng([51, touching])
    h = 60
    dense = np.zeros((h, h + touching - 1))
    for i in range(h):
        dense[i, i : i + touching] = rng.normal(size=touching)
    rows = rng.permutation(h) if shuffled else np.arange(h)
    problem = Problem(sp.csr_array(dense[rows]), np.ones(h))
    U = dense[rows] / problem.lengths[:, None]
    banded = BandedDelassus(problem)
    assert len(banded.band) == touching
    G = (U @ U.T)[np.ix_(banded.order, banded.order)]
    for k, row in enumerate(banded.band):
        np.testing.assert_allclose(row[: h - k], np.diagonal(G, -k), rtol=0, atol=1e-14)
    impulse = rng.normal(size=h)
    np.testing.assert_allclose(banded.product(impulse), G @ impulse, rtol=0, atol=1e-13)
    assert np.linalg.eigvalsh(G).max() <= banded.largest * (1 + 1e-14)
    active = rng.random(h) < 0.6
    factor = banded.factor(active, 0.1)
    assert factor is not None
    solved = factor.solve(impulse)
    assert not solved[~active].any()
    on = np.ix_(active, active)
    np.testing.assert_allclose((G[on] + 0.1 * np.eye(active.sum())) @ solved[active], impulse[active], atol=1e-12)


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
    c = Collision(sp.eye_array(6), sp.block_diag([corners, corners]), [-1.0, 0, 0, -2.0, 0, 0])
    np.testing.assert_allclose(MaximalDissipation().resolve(c).impulse, [0.25] * 4 + [0.5] * 4, rtol=1e-12)


def test_dense_solver_on_a_sparse_problem():
    c = sparse_chain(np.ones(20), first_launched(20))
    np.testing.assert_allclose(
        Moreau(0.5).resolve(c, solver="nnls").post_velocity, Moreau(0.5).resolve(c).post_velocity, atol=1e-12
    )
    with pytest.raises(SolverError, match="solver 'nnls' reached no answer on 9999 contacts"):
        Moreau(0.5).resolve(sparse_chain(np.ones(10000), first_launched(10000)), solver="nnls")


# --- the collision and its metric ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_quantities_are_those_of_arrays(seed):
    rng = np.random.default_rng([49, seed])
    blocks = [spd(rng, int(size), 1e3) for size in rng.choice([1, 2, 3, 6], size=5)]
    shuffle = rng.permutation(sum(map(len, blocks)))
    M = sp.block_diag(blocks).toarray()[np.ix_(shuffle, shuffle)]
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
    assert Collision(c.mass_matrix, c.jacobian, [1.0, 0.0]).jacobian is c.jacobian
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
