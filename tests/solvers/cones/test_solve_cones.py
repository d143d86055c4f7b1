import numpy as np
import pytest
from solvers.cones.problems import BILATERAL, BOX, CONE, dense, problem, solvable

from impactlaw.solvers.cones.solve import solve

TOLERANCE = 1e-10


def run(args, x0=None, *, exact=True, tolerance=TOLERANCE, rounds=24):
    x0 = np.zeros(len(args[-1])) if x0 is None else x0
    return solve(*args, x0, exact, tolerance, rounds, np.inf)


def permuted(args, order):
    """Return the problem with its groups in another order."""
    Y, sizes, first = dense(args), args[7], args[6]
    rows = np.concatenate([np.arange(first[g], first[g] + sizes[g]) for g in order])
    again = problem(
        Y[rows], sizes[order], args[8][order], args[11][rows], tree=args[5], bound=args[9][order],
        compliance=args[10][rows],
    )  # fmt: skip
    return again, rows


def test_one_contact_slides():
    mu = 0.5  # a unit mass that slides at 3 along x and falls at 1
    args = problem(np.diag([1.0, mu, mu]), [3], CONE, [-1.0, 3.0 * mu, 0.0])
    x, z, residual, _ = run(args)
    np.testing.assert_allclose(x, [1.0, -1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(z, [1.0, -0.5, 0.0], atol=1e-9)
    assert residual <= TOLERANCE


def test_one_contact_slides_in_the_convex_relaxation():
    # K ∋ x ⊥ u ∈ K on the boundary: u = (a, a) with a = |u_t|, x = s (1, -1), u = (s - 1, 1.5 - s / 4)
    args = problem(np.diag([1.0, 0.5]), [2], CONE, [-1.0, 1.5])
    x, _, residual, _ = run(args, exact=False)
    np.testing.assert_allclose(x, [2.0, -2.0], atol=1e-9)
    assert residual <= TOLERANCE


def test_one_contact_opens_and_one_sticks():
    args = problem(np.eye(6), [3, 3], CONE, [1.0, 2.0, 0.0, -1.0, 0.5, 0.0], tree=[0, 0, 0, 1, 1, 1])
    x, *_ = run(args)
    np.testing.assert_allclose(x, [0, 0, 0, 1.0, -0.5, 0], atol=1e-9)


def test_box_on_four_corners_sticks():
    rows = []
    for px, py in ((1, 1), (1, -1), (-1, 1), (-1, -1)):  # velocity and angular velocity of a cube of unit inertia
        r = np.array([px, py, -1.0])
        rows += [np.append(d, np.cross(r, d)) for d in np.eye(3)[[2, 0, 1]]]
    Y = np.array(rows)
    Y[np.arange(12) % 3 > 0] *= 0.8
    args = problem(Y, [3] * 4, CONE, Y @ [0.3, 0.1, -1.0, 0.0, 0.0, 0.1])
    x, z, residual, _ = run(args)
    np.testing.assert_allclose(z, [-0.3, -0.1, 1.0, 0.0, 0.0, -0.1], atol=1e-8)
    assert residual <= TOLERANCE
    assert np.abs(x).max() < 10.0


def test_box_rows_and_bilateral_rows():
    args = problem(
        np.eye(4), [1] * 4, [BOX, BOX, BILATERAL, BILATERAL], [3.0, -0.2, 2.0, 2.0],
        bound=[1.0, 1.0, 0.0, 0.0], compliance=[0.0, 0.0, 0.0, 1.0],
    )  # fmt: skip
    x, *_ = run(args)
    np.testing.assert_allclose(x, [-1.0, 0.2, -2.0, -1.0], atol=1e-9)


def test_groups_without_rows_are_harmless():
    Y = np.zeros((8, 3))
    Y[:3] = np.eye(3)
    args = problem(Y, [3, 3, 1, 1], [CONE, CONE, BILATERAL, BILATERAL], [-1.0, 0, 0, -5.0, 1, 0, 4.0, 3.0],
                   compliance=[0] * 7 + [2.0])  # fmt: skip
    x, z, residual, _ = run(args)
    np.testing.assert_allclose(x, [1, 0, 0, 0, 0, 0, 0, -1.5], atol=1e-9)
    np.testing.assert_allclose(z, [1, 0, 0], atol=1e-9)
    assert residual <= TOLERANCE


def test_no_groups():
    x, z, residual, iterations = run(problem(np.zeros((0, 3)), [], CONE, []))
    assert len(x) == 0
    assert not z.any()
    assert (residual, iterations) == (0.0, 0)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("m", [1, 3, 4, 6])
@pytest.mark.parametrize(("contacts", "nv"), [(1, 6), (3, 18), (8, 12), (30, 20)])
def test_solvable_problems(contacts, nv, m, exact):
    solved = 0
    for seed in range(5):
        args, _ = solvable(np.random.default_rng(seed), contacts, nv, m, exact=exact, extra=2, spread=1.0)
        x, z, residual, _ = run(args, exact=exact)
        assert residual == pytest.approx(solve(*args, x, exact, np.inf, 0, np.inf)[2], abs=1e-15)
        np.testing.assert_allclose(z, dense(args).T @ x, atol=1e-12 * (1 + np.abs(x).max()))
        solved += residual <= TOLERANCE
    assert solved >= (3 if exact else 5)  # exact friction with dense random rows: some solutions are not found


@pytest.mark.parametrize("exact", [True, False])
def test_large_islands(exact):
    for seed in range(3):
        args, _ = solvable(np.random.default_rng(seed), 80, 180, exact=exact, trees=30)
        _, _, residual, _ = run(args, exact=exact)
        assert residual <= TOLERANCE


@pytest.mark.parametrize("exact", [True, False])
def test_compliant_rows_of_a_cone(exact):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        args, x = solvable(rng, 6, 12, 4, exact=exact)
        c = np.tile([0.0, 0.0, 0.0, 0.3], 6)
        args = (*args[:10], c, args[11] - c * x)
        again, _, residual, _ = run(args, exact=exact)
        assert residual <= TOLERANCE
        if not exact:
            np.testing.assert_allclose(c * again, c * x, atol=1e-6)


def test_a_good_guess_costs_no_step():
    args, _ = solvable(np.random.default_rng(0), 6, 12)
    x, *_ = run(args)
    again, _, _, iterations = run(args, x)
    assert iterations == 0
    np.testing.assert_array_equal(again, x)


def test_order_of_groups_does_not_matter():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        args, _ = solvable(rng, 10, 12, exact=False, extra=3)
        other, _ = permuted(args, rng.permutation(13))
        np.testing.assert_allclose(run(other, exact=False)[1], run(args, exact=False)[1], atol=1e-7)


def test_rows_or_degrees_of_freedom_give_the_same_jump():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        args, _ = solvable(rng, 4, 20, exact=False)  # fewer rows than velocities: the system of the rows is solved
        Y, b = dense(args), args[11]
        twice = problem(np.vstack([Y, Y]), [3] * 8, CONE, np.append(b, b))  # more rows, the same motion
        np.testing.assert_allclose(run(twice, exact=False)[1], run(args, exact=False)[1], atol=1e-7)


def test_islands_are_one_problem():
    rng = np.random.default_rng(3)
    parts = [solvable(rng, k, 6, exact=False)[0] for k in (1, 2, 3, 4)]
    n = sum(len(p[11]) for p in parts)
    Y, o = np.zeros((n, 24)), 0
    for k, p in enumerate(parts):
        Y[o : o + len(p[11]), 6 * k : 6 * k + 6] = dense(p)
        o += len(p[11])
    b = np.concatenate([p[11] for p in parts])
    apart = problem(Y, [3] * 10, CONE, b, tree=np.arange(24) // 6)
    together = problem(Y, [3] * 10, CONE, b)
    z = run(apart, exact=False)[1]
    np.testing.assert_allclose(z, run(together, exact=False)[1], atol=1e-7)
    np.testing.assert_allclose(z, np.concatenate([run(p, exact=False)[1] for p in parts]), atol=1e-7)


@pytest.mark.parametrize("exact", [True, False])
def test_conflict_ends_with_bounded_work(exact):
    rng = np.random.default_rng(1)
    Y = np.zeros((24, 6))
    Y[:3] = rng.normal(size=(3, 6))
    Y[3:6] = -Y[:3]  # two opposing walls: no motion leaves both at speed 1
    Y[6:] = rng.normal(size=(18, 6))
    args = problem(Y, [3] * 8, CONE, np.tile([-1.0, 0.2, 0.1], 8))
    x, _, residual, iterations = run(args, exact=exact)
    assert np.isfinite(x).all()
    assert 1e-3 < residual < np.inf
    assert iterations < 5000


def test_bilateral_conflict():
    args = problem([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [1, 1, 1], [BILATERAL, BILATERAL, CONE], [1.0, -1.0, -1.0])
    x, z, residual, _ = run(args)
    assert np.isfinite(x).all()
    assert residual == pytest.approx(np.sqrt(2.0), rel=1e-3)
    np.testing.assert_allclose(z, [0.0, 1.0], atol=1e-6)


def test_guess_that_is_no_number():
    args, _ = solvable(np.random.default_rng(0), 4, 12)
    x, _, residual, _ = run(args, np.full(len(args[11]), np.nan))
    assert residual <= TOLERANCE
    assert np.isfinite(x).all()


def test_compiles_once_for_all_sizes():
    assert len(solve.signatures) == 1
