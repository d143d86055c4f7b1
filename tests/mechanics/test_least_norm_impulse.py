"""The impulses of redundant contacts have least norm."""

import numpy as np
import pytest
import scipy
from certificates import least_norm_error
from problems import box, launched, random_collision

from impactlaw import Collision, Impact, MaximalDissipation, Moreau, Newton
from impactlaw.solvers import SOLVERS
from impactlaw.solvers.least_norm import share_impulse

EXACT = {"rtol": 0, "atol": 1e-12}


def tight(impact: Impact) -> np.ndarray:
    c = impact.collision
    target = impact.post_contact_velocity if impact.target_contact_velocity is None else impact.target_contact_velocity
    return impact.post_contact_velocity - target <= 1e-9 * c.pre_speed * c.gradient_norms


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.5001, 2.0])
@pytest.mark.parametrize("side", [2, 3, 8])
def test_symmetric_scene_has_symmetric_impulses(side, tilt):
    """The box tilts about x only, so that contacts along x share equally; from 1.5 on only one edge has impulses."""
    impact = Moreau(0.5).resolve(box(side, tilt))
    rows = impact.impulse.reshape(side, side)
    np.testing.assert_allclose(rows, np.repeat(rows.mean(axis=1, keepdims=True), side, axis=1), **EXACT)
    assert least_norm_error(impact.impulse, tight(impact), impact.collision.jacobian) < 1e-12
    assert impact.residual < 1e-12
    assert (rows[1:] == 0).all() if tilt > 1.5 else (rows[0] > 0).all()


@pytest.mark.parametrize("seed", range(30))
def test_box_on_64_points_moved_by_any_of_them(seed):
    """Known impulses act at some of the points; at others the sign of the least-norm impulse decides."""
    rng = np.random.default_rng([31, seed])
    c = box(8)
    pushed = rng.uniform(size=64) * (rng.uniform(size=64) < rng.choice([0.05, 0.2, 1.0]))
    pushed[rng.integers(64)] = 1.0
    v = c.pre_velocity + np.linalg.solve(c.mass_matrix, c.jacobian.T @ pushed)
    impact = Impact.observed(c, v)
    assert impact.violations.kinetic < 1e-12 * c.pre_speed
    np.testing.assert_allclose(c.jacobian.T @ impact.impulse, c.jacobian.T @ pushed, atol=1e-10)
    assert np.linalg.norm(impact.impulse) <= np.linalg.norm(pushed) * (1 + 1e-12)
    assert least_norm_error(impact.impulse, np.ones(64, dtype=bool), c.jacobian) < 1e-10


@pytest.mark.parametrize("copies", [2, 5])
def test_duplicates_share_alike(copies):
    c = launched(4, 2)
    one = Newton([0.3, 0.8, 0.5]).resolve(c)
    J = np.repeat(c.jacobian, copies, axis=0)
    many = Newton(np.repeat([0.3, 0.8, 0.5], copies).tolist()).resolve(Collision(c.mass_matrix, J, c.pre_velocity))
    np.testing.assert_allclose(many.post_velocity, one.post_velocity, **EXACT)
    np.testing.assert_allclose(many.impulse, np.repeat(one.impulse, copies) / copies, **EXACT)


def test_duplicates_of_different_scale_share_by_least_squares():
    """Multiples 1, 2 and 3 of one gradient: min |Lambda| with Lambda_1 + 2 Lambda_2 + 3 Lambda_3 = p."""
    c = Collision([[2.0]], [[1.0], [2.0], [3.0]], [-7.0])
    np.testing.assert_allclose(MaximalDissipation().resolve(c).impulse, [1.0, 2.0, 3.0], **EXACT)


@pytest.mark.parametrize("seed", range(60))
def test_least_norm_of_random_redundant_contacts(seed):
    """Against the pseudo-inverse on every set of contacts that may carry the jump."""
    rng = np.random.default_rng([32, seed])
    h, nv, rank = 7, 5, int(rng.integers(1, 4))
    J = np.abs(rng.normal(size=(h, rank))) @ rng.normal(size=(rank, nv))
    c = Collision(np.diag(rng.uniform(0.5, 2.0, nv)), J, rng.normal(size=nv))
    jump = rng.uniform(size=h) * (rng.uniform(size=h) < 0.5) @ J
    impact = Impact.observed(c, c.pre_velocity + np.linalg.solve(c.mass_matrix, jump))
    best = np.inf
    for mask in range(1, 2**h):
        on = [i for i in range(h) if mask >> i & 1]
        lam = np.linalg.lstsq(J[on].T, jump, rcond=1e-11)[0]
        if lam.min() >= -1e-12 and np.linalg.norm(lam @ J[on] - jump) < 1e-11:
            best = min(best, np.linalg.norm(lam))
    assert np.linalg.norm(impact.impulse) == pytest.approx(0.0 if not jump.any() else best, rel=1e-9)
    np.testing.assert_allclose(impact.impulse @ J, jump, atol=1e-10)


@pytest.mark.parametrize("seed", [*range(40), 135, 282, 357, 422])
def test_least_norm_of_duplicates_of_random_scale(seed):
    """Twenty contacts with up to five gradients, some of them once, rows and masses over six orders of magnitude."""
    rng = np.random.default_rng([34, seed])
    nv = int(rng.integers(2, 8))
    J = rng.normal(size=(int(rng.integers(1, 6)), nv))
    J = J[np.minimum(rng.integers(0, 8, 20), len(J) - 1)] * 10.0 ** rng.uniform(-3, 3, (20, 1))
    c = Collision(np.diag(10.0 ** rng.uniform(-3, 3, nv)), J, rng.normal(size=nv))
    pushed = (rng.uniform(size=20) + 0.1) * (rng.uniform(size=20) < 0.5)
    impact = Impact.observed(c, c.pre_velocity + np.linalg.solve(c.mass_matrix, pushed @ J))
    assert np.linalg.norm(impact.impulse) <= np.linalg.norm(pushed) * (1 + 1e-9)
    assert least_norm_error(impact.impulse, np.ones(20, dtype=bool), c.whitened_jacobian) < 1e-8


def test_least_norm_of_random_collisions():
    """All contacts that may carry the impulse share it with least norm, for rows of moderately different length."""
    checked = 0
    for i in range(400):
        c = random_collision(np.random.default_rng([33, i]), most=24)
        if not c.labels or np.ptp(np.log10(np.maximum(c.gradient_norms, 1e-12))) > 3:
            continue
        scaled = np.linalg.svd(c.whitened_jacobian / c.gradient_norms[:, None], compute_uv=False)
        if not ((scaled < 1e-13 * scaled[0]) | (scaled > 1e-4 * scaled[0])).all():
            continue  # neither dependent nor independent: the set of sharing contacts depends on the tolerance
        impact = Moreau(0.5).resolve(c)
        if not impact.impulse.any():
            continue
        checked += 1
        carries = impact.impulse > 0
        slack = (impact.post_contact_velocity - impact.target_contact_velocity) / c.gradient_norms
        may = carries | (slack <= 1e-9 * 1.5 * c.pre_speed)
        assert least_norm_error(impact.impulse, may, c.whitened_jacobian) < 1e-8
    assert checked > 100


@pytest.mark.parametrize("solver", ["auto", *(name for name in SOLVERS if name != "closed-form")])
def test_parallel_gradients_share_under_every_solver(solver):
    """The least-norm solution of ``Lambda_1 + 2 Lambda_2 = 1.5`` is (0.3, 0.6); closed form is for one contact."""
    impact = Moreau(0.5).resolve(Collision([[1.0]], [[1.0], [2.0]], [-1.0]), solver=solver)
    np.testing.assert_allclose(impact.impulse, [0.3, 0.6], rtol=1e-6)


def test_groups_of_sparse_contacts_share_among_themselves():
    """Three equal contacts on one body, two on another, one of them with twice the lever, and a single one."""
    Y = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1], [0, 2, 0], [1, 0, 0]])
    impulse, tight = np.array([3.0, 5.0, 0.0, 7.0, 0.0, 0.0]), np.ones(6, dtype=bool)
    shared = share_impulse(scipy.sparse.csr_array(Y), impulse, tight)
    np.testing.assert_allclose(shared, [1, 1, 1, 7, 2, 1], atol=1e-12)
    np.testing.assert_allclose(share_impulse(Y, impulse, tight), shared, atol=1e-12)
    tight[5] = False
    shared = share_impulse(scipy.sparse.csr_array(Y), impulse, tight)
    np.testing.assert_allclose(shared, [1.5, 1, 1.5, 7, 2, 0], atol=1e-12)
    tight[4] = False  # only contacts of the first group share
    shared = share_impulse(scipy.sparse.csr_array(Y), impulse, tight)
    np.testing.assert_allclose(shared, [1.5, 5, 1.5, 7, 0, 0], atol=1e-12)
