"""Chains and piles with sparse mass matrices and Jacobians: exact answers."""

import numpy as np
import pytest
import scipy.sparse as sp
from problems import disks, sparse_chain

from impactlaw import Collision, Fremond, Impact, MaximalDissipation, Moreau, Newton
from impactlaw.errors import RestitutionError
from impactlaw.solvers import SOLVERS, Problem, Status
from impactlaw.solvers.methods.banded_delassus import BandedDelassus


def first_launched(n: int) -> np.ndarray:
    return (np.arange(n) == 0).astype(float)


def assert_law(impact: Impact, target: np.ndarray, tol: float = 1e-10) -> None:
    """Check momentum and complementarity by sparse products alone, for diagonal M."""
    c = impact.collision
    m = c.mass_matrix.diagonal()
    lengths = np.sqrt((c.jacobian.power(2) / m).sum(axis=1))
    speed = max(np.sqrt(m @ c.pre_velocity**2), np.sqrt(m @ impact.post_velocity**2))
    momentum = m * (impact.post_velocity - c.pre_velocity) - c.jacobian.T @ impact.impulse
    assert np.linalg.norm(momentum / np.sqrt(m)) <= tol * speed
    slack = (c.jacobian @ impact.post_velocity - target) / lengths
    assert np.abs(np.minimum(impact.impulse * lengths, slack)).max() <= tol * speed
    assert impact.residual <= tol


@pytest.mark.parametrize("n", [3, 101, 1001, 10001])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_moreau_of_a_launched_ball(n, e):
    """v+ = (1 + e) p - e v- with the common velocity p = 1/n; the impulses decrease linearly along the chain."""
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
    """A chain whose last ball rests against a wall: under the elastic law all of the energy comes back."""
    n = 1000
    J = sp.diags_array([-np.ones(n), np.ones(n - 1)], offsets=[0, 1], shape=(n, n))
    c = Collision(sp.eye_array(n), J, first_launched(n))
    np.testing.assert_allclose(MaximalDissipation().resolve(c).post_velocity, np.zeros(n), atol=1e-12)
    impact = Moreau(1.0).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, -first_launched(n), atol=1e-12)
    np.testing.assert_allclose(impact.impulse, 2.0, rtol=1e-10)


@pytest.mark.parametrize("n", [1000, 10000])
@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_random_chain(n, spread):
    """Masses over 0 and 6 orders of magnitude, random velocities: some contacts separate."""
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
    """Redundant contacts: G is singular if there are no holes. The velocity is that of NNLS on dense arrays."""
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
    """100 problems with any gradients, sparse or dependent: an answer or none, but never a wrong one."""
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
    """Each contact shares degrees of freedom with the ``touching - 1`` next ones; up to 8, and more than 8."""
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
