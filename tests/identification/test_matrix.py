"""A full restitution matrix: fitted again, certified, as good as a semidefinite program, with an honest rank."""

import numpy as np
import pytest
from identification.known import active_collisions, open_collisions
from problems import balls, launched
from scipy import sparse

from impactlaw import Collision, Fremond, Newton
from impactlaw.errors import MeasurementError
from impactlaw.identification import cross_validate, fit
from impactlaw.identification.measurements import Measurements
from impactlaw.identification.restitution_matrix import MatrixFit, Quadratic, constrained


def found_matrix(found, c):
    return found.law.restitution_matrix(c)


@pytest.mark.parametrize("h", range(1, 9))
def test_known_matrix_without_noise(h):
    E, collisions, after = active_collisions(h, 6 * h, h)
    found = fit(collisions, after, "fremond")
    np.testing.assert_allclose(found_matrix(found, collisions[0]), E, rtol=0, atol=1e-12 * max(1, np.abs(E).max()))
    assert found.rank == h
    assert found.certificate == pytest.approx(1 / 1.05, abs=1e-10)
    assert found.rms < 1e-12


@pytest.mark.parametrize("h", [2, 4, 8])
def test_known_matrix_with_open_contacts(h):
    E, collisions, after = open_collisions(h, 40 * h, h)
    found = fit(collisions, after, "fremond")
    np.testing.assert_allclose(found_matrix(found, collisions[0]), E, rtol=0, atol=1e-10)
    # plain least squares, which treats open contacts as equations, is far off
    gamma = np.array([c.pre_contact_velocity for c in collisions])
    plus = np.array([c.jacobian @ v for c, v in zip(collisions, after, strict=True)])
    plain = -np.linalg.lstsq(gamma, plus, rcond=None)[0].T
    assert np.abs(plain - E).max() > 0.1


def test_error_falls_as_one_over_the_root_of_n():
    errors = {}
    for n in (25, 400):
        found = [active_collisions(3, n, seed, noise=0.02) for seed in range(12)]
        errors[n] = np.median([np.abs(found_matrix(fit(c, v, "fremond"), c[0]) - E).max() for E, c, v in found])
    assert 2.5 < errors[25] / errors[400] < 6.5  # 4 on average


@pytest.mark.parametrize("seed", range(8))
def test_certificate_is_never_above_one(seed):
    h = 1 + seed % 4
    rng = np.random.default_rng([1, seed])
    collisions = active_collisions(h, 12 * h, seed)[1]
    after = [v.pre_velocity - 2.4 * rng.uniform() * v.pre_velocity for v in collisions]  # energy may grow
    found = fit(collisions, after, "fremond")
    assert found.certificate <= 1.0 + 1e-12
    E, G = found_matrix(found, collisions[0]), collisions[0].delassus
    L = np.linalg.cholesky(G)
    assert np.linalg.norm(np.linalg.solve(L, E @ L), 2) <= 1.0 + 1e-12


def value(q: Quadratic, F: np.ndarray) -> float:
    x = F.ravel()
    return float(0.5 * x @ q.H @ x + q.g @ x)


def semidefinite(q: Quadratic, h: int) -> np.ndarray:
    """Return the minimum over |F|_2 <= 1 by Clarabel: ``(1 F; F^T 1) >= 0``."""
    import clarabel

    n, side = h * h, 2 * h
    rows, columns, values, b = [], [], [], []
    place = 0
    for j in range(side):  # upper triangle, column by column, off-diagonal entries times the root of two
        for i in range(j + 1):
            constant = float(i == j)
            if i < h <= j:
                rows.append(place)
                columns.append(i * h + j - h)
                values.append(-np.sqrt(2.0))
            b.append(constant)
            place += 1
    A = sparse.csc_matrix((values, (rows, columns)), shape=(place, n))
    found = []
    for tolerance in (1e-12, 1e-14):  # it may stall before it reaches the smaller tolerance
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        cone = [clarabel.PSDTriangleConeT(side)]
        solver = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(q.H)), q.g, A, np.array(b), cone, settings)
        found.append(np.array(solver.solve().x).reshape(h, h))
    return min(found, key=lambda F: value(q, F))


@pytest.mark.parametrize("seed", range(6))
def test_agrees_with_a_semidefinite_program(seed):
    h, rng = 2 + seed % 3, np.random.default_rng([2, seed])
    A = rng.normal(size=(20 * h * h, h * h)) / (20 * h)
    q = Quadratic(A.T @ A, -A.T @ A @ (3.0 * rng.normal(size=h * h)))
    F = constrained(q, h)
    reference = semidefinite(q, h)
    assert np.linalg.norm(F, 2) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(F, reference, rtol=0, atol=1e-7)
    assert value(q, F) <= value(q, reference) + 1e-9 * abs(value(q, reference))


def test_launching_one_ball_tells_one_column():
    after = [Fremond.reversal().resolve(launched(4, 1)).post_velocity] * 3
    collisions = [launched(4, 1)] * 3
    found = fit(collisions, after, "fremond")
    assert found.rank == 1
    np.testing.assert_allclose(found_matrix(found, launched(4, 1))[:, 0], [0.0, 0.0, 1.0], rtol=0, atol=1e-9)
    assert all(np.isnan(low) for low, _ in found.confidence.values())


def test_contacts_in_any_order_and_spelling():
    E = np.array([[0.2, 0.5], [0.1, 0.4]])
    rng = np.random.default_rng(3)
    collisions, after = [], []
    for i in range(30):
        c = balls([1.0, 2.0, 1.5], np.sort(rng.normal(size=3))[::-1])
        labels = ("a/b", "b/c")
        J, L = (c.jacobian, labels) if i % 2 else (c.jacobian[::-1], ("c/b", "b/a"))
        own = E if i % 2 else E[::-1, ::-1]
        c = Collision(c.mass_matrix, J, c.pre_velocity, labels=L)
        collisions.append(c)
        after.append(Fremond(own).resolve(c).post_velocity)
    found = fit(collisions, after, "fremond")
    assert found.rms < 1e-10
    np.testing.assert_allclose(found_matrix(found, collisions[1]), E, rtol=0, atol=1e-10)


def test_projection_is_never_worse_and_admissible_matrices_stay_in_s():
    _, collisions, after = open_collisions(3, 60, 5)
    rng = np.random.default_rng(6)
    after = [
        v + 0.1 * c.pre_speed * rng.normal(size=len(v)) / np.sqrt(np.diag(c.mass_matrix))
        for c, v in zip(collisions, after, strict=True)
    ]
    after = [c.admissible_set.project(v) for c, v in zip(collisions, after, strict=True)]
    plain, projected = (fit(collisions, after, "fremond", projected=p) for p in (False, True))
    assert (projected.residuals <= plain.residuals + 1e-9).all()
    for c in collisions[:20]:
        assert c.admissible_set.contains(projected.law.resolve(c).post_velocity, 1e-7)


def test_admissible_matrices_neither_penetrate_nor_pull():
    rng = np.random.default_rng(7)
    collisions = [balls(np.ones(4), np.sort(rng.normal(size=4))[::-1]) for _ in range(60)]
    after = [v + 0.2 * rng.normal(size=4) for v in (Fremond.reversal().resolve(c).post_velocity for c in collisions)]
    found = fit(collisions, after, "fremond", admissible=True)
    E, G = found_matrix(found, collisions[0]), collisions[0].delassus
    assert E.min() > -1e-8
    assert np.linalg.solve(G, np.eye(3) + E).min() > -1e-8
    assert found.certificate <= 1 + 1e-12
    with pytest.raises(MeasurementError, match="restricts a full matrix"):
        fit(collisions, after, "newton", admissible=True)


def test_intervals_cover():
    hits, total = 0, 0
    for seed in range(60):
        E, collisions, after = active_collisions(2, 60, 0)
        rng = np.random.default_rng([8, seed])
        L = np.linalg.cholesky(collisions[0].mass_matrix)
        after = [
            v + 0.02 * c.pre_speed * np.linalg.solve(L.T, rng.normal(size=len(v)))
            for c, v in zip(collisions, after, strict=True)
        ]
        found = fit(collisions, after, "fremond")
        for (i, j), (low, high) in zip(np.ndindex(2, 2), found.confidence.values(), strict=True):
            hits += low <= E[i, j] <= high
            total += 1
    assert 0.90 <= hits / total <= 0.98


def test_intervals_cover_a_contact_that_few_collisions_close():
    """Only collisions in which a contact carries an impulse determine its row of E."""
    E, hits = np.array([[0.3, 0.1], [0.05, 0.5]]), 0
    for seed in range(60):
        rng, cs = np.random.default_rng([14, seed]), []
        for second in [2.0] * 20 + [-1.0] * 4:
            gamma = np.array([-rng.uniform(0.2, 1.0), second * rng.uniform(1.0, 2.0)])
            v = np.concatenate([[0.0], np.cumsum(gamma)])
            cs.append(balls(np.ones(3), v))
        after = [Fremond(E).resolve(c).post_velocity + 0.01 * c.pre_speed * rng.normal(size=3) for c in cs]
        found = list(fit(cs, after, "fremond").confidence.values())[2:]
        hits += sum(low <= truth <= high for truth, (low, high) in zip(E[1], found, strict=True))
    assert hits >= 108


def test_mixed_sets_are_refused_and_chosen():
    rng = np.random.default_rng(9)
    two = [balls(np.ones(3), np.sort(rng.normal(size=3))[::-1]) for _ in range(10)]
    one = [Collision(np.eye(2), [[-1.0, 1.0]], [1.0, 0.0], labels=("a",))] * 5
    after = [Newton(0.5).resolve(c).post_velocity for c in two + one]
    with pytest.raises(MeasurementError, match=r"one set of closed contacts, but there are 2: 0 1 \(10\); a \(5\)"):
        fit(two + one, after, "fremond")
    found = fit(two + one, after, "fremond", contacts=("0", "1"))
    np.testing.assert_allclose(found_matrix(found, two[0]), 0.5 * np.eye(2), rtol=0, atol=1e-10)
    with pytest.raises(MeasurementError, match="no collision has exactly the contacts x"):
        fit(two + one, after, "fremond", contacts=("x",))
    with pytest.raises(MeasurementError, match="contacts is empty: there is nothing to fit"):
        fit(two + one, after, "fremond", contacts=())


def test_a_text_is_the_label_of_one_contact():
    """It is not read as the set of its letters."""
    one = [Collision(np.eye(2), [[-1.0, 1.0]], [1.0, 0.0], labels=("a/b",))] * 5
    other = [balls(np.ones(3), [1.0, 0.0, -1.0])] * 5
    after = [Newton(0.5).resolve(c).post_velocity for c in one] + [Newton(0.9).resolve(c).post_velocity for c in other]
    found = fit(one + other, after, "newton", contacts="b/a")
    assert found.parameters == pytest.approx({"restitution": 0.5}, abs=1e-7)


def test_redundant_contacts_are_refused():
    c = Collision([[1.0]], [[1.0], [1.0]], [-1.0])
    with pytest.raises(MeasurementError, match="depend on each other"):
        fit([c, c], [[0.5], [0.5]], "fremond")


def test_varying_configuration():
    """G changes from collision to collision; E does not, and is small enough for all of them."""
    rng = np.random.default_rng(10)
    E, collisions, after = np.array([[0.3, 0.1], [0.05, 0.4]]), [], []
    for _ in range(40):
        J = np.eye(2, 3) + 0.1 * rng.normal(size=(2, 3))
        c = Collision(np.diag([1.0, 2.0, 1.5]), J, np.linalg.lstsq(J, -rng.exponential(size=2), rcond=None)[0])
        collisions.append(c)
        after.append(Fremond(E).resolve(c).post_velocity)
    found = fit(collisions, after, "fremond")
    np.testing.assert_allclose(found_matrix(found, collisions[0]), E, rtol=0, atol=1e-10)
    norms = MatrixFit(Measurements(collisions, after), np.tile([0, 1], (40, 1)))
    assert found.certificate == pytest.approx(norms.bound(norms.inverse_root @ E @ norms.root), abs=1e-9)


def test_cross_validation_sees_what_fitting_does_not():
    _, collisions, after = active_collisions(3, 40, 11, noise=0.05)
    held = cross_validate(collisions, after, "fremond", folds=4)
    assert held.rms > fit(collisions, after, "fremond").rms
    assert held.fold_rms.shape == (4,)
    again = cross_validate(collisions, after, "fremond", folds=4)
    assert again.rms == held.rms
    with pytest.raises(MeasurementError, match="cannot be split into 41 folds"):
        cross_validate(collisions, after, "fremond", folds=41)
