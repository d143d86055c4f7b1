"""Bilateral constraints against minimal coordinates by hand; moving surfaces against relative motion."""

import numpy as np
import pytest
from problems import LAWS, PROBLEMS, balls, launched, rod

from impactlaw import (
    Collision,
    Impact,
    Law,
    MaximalDissipation,
    Moreau,
    Newton,
)
from impactlaw.errors import InvalidCollisionError, UnsolvableLawError


def constrained(seed: int, *, moving: bool = False) -> tuple[Collision, np.ndarray, np.ndarray]:
    """Return a random collision with redundant bilateral constraints, a basis of free motion, and their velocity."""
    rng = np.random.default_rng(seed)
    nv, m, h = 9, int(rng.integers(1, 6)), int(rng.integers(1, 8))
    A = rng.normal(size=(nv, nv))
    J_eq = rng.normal(size=(m, nv))
    basis = np.linalg.svd(J_eq)[2][m:].T
    fixed = J_eq.T @ rng.normal(size=m) if moving else np.zeros(nv)
    J_eq = np.vstack([J_eq, rng.normal(size=(3, m)) @ J_eq, np.zeros(nv)])
    J = rng.normal(size=(h, nv))
    J *= -np.sign(J @ (basis @ np.ones(nv - m)))[:, None]
    velocity = basis @ np.ones(nv - m) + fixed
    return Collision(A @ A.T + 0.1 * np.eye(nv), J, velocity, bilateral_jacobian=J_eq), basis, fixed


def resolved_alike(law: Law, c: Collision, other: Collision) -> tuple[Impact, Impact] | None:
    """Return the impacts of two collisions, or None if the law can solve neither."""
    try:
        expected = law.resolve(other)
    except UnsolvableLawError:
        with pytest.raises(UnsolvableLawError):
            law.resolve(c)
        return None
    return law.resolve(c), expected


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("name", [name for name in LAWS if name != "linear map"])
def test_constraints_are_minimal_coordinates(name, seed, moving):
    c, basis, fixed = constrained(seed, moving=moving)
    N, M = basis, c.mass_matrix
    at_rest = fixed - N @ np.linalg.solve(N.T @ M @ N, N.T @ M @ fixed)  # kinetically orthogonal to the free motion
    own = np.linalg.lstsq(N, c.pre_velocity - at_rest, rcond=None)[0]
    reduced = Collision(N.T @ M @ N, c.jacobian @ N, own, surface_velocity=c.jacobian @ at_rest)
    law = LAWS[name](c)
    if (impacts := resolved_alike(law, c, reduced)) is None:
        return
    impact, expected = impacts
    np.testing.assert_allclose(impact.post_velocity, N @ expected.post_velocity + at_rest, rtol=0, atol=1e-8)
    np.testing.assert_allclose(c.bilateral_jacobian @ (impact.post_velocity - c.pre_velocity), 0.0, atol=1e-8)
    np.testing.assert_allclose(c.delassus, reduced.delassus, rtol=0, atol=1e-8 * np.abs(c.delassus).max())
    assert impact.residual < 1e-9
    assert impact.violations.kinetic < 1e-8 * c.pre_speed
    np.testing.assert_allclose(impact.energy_change, expected.energy_change, rtol=0, atol=1e-7 * c.kinetic_energy)
    np.testing.assert_allclose(impact.surface_work, expected.surface_work, rtol=0, atol=1e-7 * c.kinetic_energy)
    np.testing.assert_allclose(
        [impact.violations.kinematic, impact.violations.energetic],
        [expected.violations.kinematic, expected.violations.energetic],
        rtol=0,
        atol=1e-7 * c.pre_speed,
    )


def test_welded_balls_are_one_ball():
    """Balls 2 and 3 of three are welded, three times over: the masses are 1 and 2."""
    c = launched(3, 1)
    welded = Collision(c.mass_matrix, c.jacobian[:1], c.pre_velocity, bilateral_jacobian=[[0.0, 1.0, -1.0]] * 3)
    impact = Moreau(1.0).resolve(welded)
    np.testing.assert_allclose(impact.post_velocity, [-1 / 3, 2 / 3, 2 / 3], atol=1e-15)
    np.testing.assert_allclose(impact.impulse, [4 / 3], atol=1e-15)
    assert impact.energy_change == pytest.approx(0.0, abs=1e-15)


def test_the_effective_mass_of_a_slider_crank():
    """A crank (inertia 2, length 1, at 45 degrees) drives a slider of mass 3 on a line by a massless rod.

    With rod and crank at right angles and both of length 1, the slider's velocity is -sqrt(2) times the crank's angular
    velocity: if the slider is hit, the mechanism has the effective mass 3 + 2 / 2.
    """
    J_eq = [[np.sqrt(2.0), 1.0]]
    c = Collision(np.diag([2.0, 3.0]), [[0.0, 1.0]], [1.0, -np.sqrt(2.0)], bilateral_jacobian=J_eq)
    impact = Newton(0.5).resolve(c)
    np.testing.assert_allclose(impact.impulse, [4.0 * 1.5 * np.sqrt(2.0)], rtol=1e-14)
    np.testing.assert_allclose(impact.post_velocity, [-0.5, 0.5 * np.sqrt(2.0)], rtol=1e-14)


def test_a_contact_that_constraints_hold_takes_no_part():
    held = {"bilateral_jacobian": [[1.0, 1.0, 0.0]]}
    J = [[1.0 / 3.0, 1.0 / 3.0, 0.0], [0.0, 0.0, 1.0]]
    c = Collision(np.diag([1.0, 2.0, 3.0]), J, [0.1 + 0.2, -0.3, -1.0], **held)
    impact = Moreau(0.5).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [0.3, -0.3, 0.5], atol=1e-15)
    with pytest.raises(UnsolvableLawError):
        Moreau(0.5).resolve(Collision(np.diag([1.0, 2.0, 3.0]), J, [-1.0, 0.0, 0.0], **held))


@pytest.mark.parametrize(
    "law", [name for name in LAWS if name != "linear map"]
)  # it is not a law of relative velocities
@pytest.mark.parametrize("problem", [name for name in PROBLEMS if name != "contact that cannot move"])
def test_surfaces_that_move_together_see_the_bodies_move(law, problem):
    """All surfaces move with V: the impact is that of v- + V on surfaces at rest, minus V."""
    c = PROBLEMS[problem]()
    V = np.random.default_rng(7).normal(size=len(c.pre_velocity)) * max(c.pre_speed, 1.0)
    V /= c.metric.norm(V)
    moving = Collision(c.mass_matrix, c.jacobian, c.pre_velocity - V, surface_velocity=c.jacobian @ V)
    if (impacts := resolved_alike(LAWS[law](c), moving, c)) is None:
        return
    impact, expected = impacts
    tol = 1e-8 * max(c.pre_speed, 1.0)
    gap = c.metric.norm(impact.post_velocity + V - expected.post_velocity)
    assert gap < tol
    assert impact.residual < 1e-9
    assert abs(impact.violations.kinematic - expected.violations.kinematic) < 10 * tol
    gain = impact.energy_change - impact.surface_work
    assert abs(gain - expected.energy_change) < 10 * tol * max(c.pre_speed, c.metric.norm(expected.post_velocity), 1.0)
    worst = max(expected.violations.kinematic, expected.violations.kinetic, expected.violations.energetic)
    if 1e-9 < worst / max(c.pre_speed, 1e-300) < 1e-5:
        return  # so close to the boundary of S that the scale of the tolerance decides
    if problem == "heavy ball hits light ones":
        return  # gradients of mass ratio 1e12: the common velocity of the surfaces is lost to rounding
    assert moving.admissible_set.contains(impact.post_velocity, 1e-7) == c.admissible_set.contains(
        expected.post_velocity, 1e-7
    )


def test_bat_and_ball():
    """v+ = -e v- + (1 + e) u on a surface of velocity u; the energy gain is the work of the surface."""
    e, v, u, m = 0.8, -3.0, 2.0, 0.5
    c = Collision([[m]], [[1.0]], [v], surface_velocity=[-u])
    impact = Newton(e).resolve(c)
    assert impact.post_velocity[0] == pytest.approx(-e * v + (1 + e) * u)
    assert impact.surface_work == pytest.approx(impact.impulse[0] * u)
    assert impact.energy_change - impact.surface_work == pytest.approx(-0.5 * m * (1 - e * e) * (v - u) ** 2)
    assert impact.violations.is_admissible()
    assert impact.post_contact_velocity[0] == pytest.approx(-e * c.pre_contact_velocity[0])
    low, high = c.admissible_set.intensity_range()
    assert (low, high) == pytest.approx((np.sqrt(m) * 5.0, np.sqrt(m) * 10.0))


def test_hammer_blow_under_a_stack():
    """The table jumps to velocity u under three balls at rest: this alone is a collision, and they move with it."""
    u = 2.0
    J = np.vstack([[1.0, 0.0, 0.0], np.diff(np.eye(3), axis=0)])
    c = Collision(np.diag([1.0, 2.0, 3.0]), J, np.zeros(3), post_surface_velocity=[-u, 0.0, 0.0])
    for law in (MaximalDissipation(), Moreau(1.0), Newton([0.9, 0.1, 0.5])):
        impact = law.resolve(c)
        np.testing.assert_allclose(impact.post_velocity, u, rtol=1e-14)
        np.testing.assert_allclose(impact.impulse, [12.0, 10.0, 6.0], rtol=1e-14)
        assert impact.energy_change == pytest.approx(12.0)
        assert impact.surface_work == pytest.approx(12.0)  # the table's mean velocity u / 2, times 12 N s
        assert impact.violations.is_admissible()
    with pytest.raises(InvalidCollisionError, match="jumps"):
        _ = c.admissible_set


def test_a_hammer_blow_adds_to_an_impact():
    """A ball arrives when the table jumps: gamma+ = -e gamma-, each with the table's velocity on that side."""
    e, v, before, after = 0.5, -1.0, 0.25, 2.0
    c = Collision([[1.0]], [[1.0]], [v], surface_velocity=[-before], post_surface_velocity=[-after])
    impact = Newton(e).resolve(c)
    assert impact.post_velocity[0] == pytest.approx(after - e * (v - before))
    assert impact.energy_change - impact.surface_work == pytest.approx(
        impact.impulse[0] * impact.mean_contact_velocity[0]
    )


def test_surfaces_that_crush_what_is_between_them():
    between = Collision(
        [[2.0]], [[1.0], [-1.0]], [0.0], surface_velocity=[-1.0, -1.0], labels=("left/ball", "ball/right")
    )
    with pytest.raises(UnsolvableLawError, match=r"left/ball.*ball/right"):
        Moreau(0.5).resolve(between)
    assert Impact.observed(between, [0.0]).violations.kinematic == np.inf
    opening = Collision([[2.0]], [[1.0], [-1.0]], [0.0], surface_velocity=[-1.0, 1.5])
    impact = MaximalDissipation().resolve(opening)
    np.testing.assert_allclose(impact.post_velocity, [1.0])
    assert impact.violations.is_admissible()
    with pytest.raises(InvalidCollisionError, match="against each other"):
        _ = opening.admissible_set


def test_observed_outcomes_are_judged_from_the_surface():
    c = Collision([[1.0]], [[1.0]], [-1.0], surface_velocity=[-1.0])
    assert Impact.observed(c, [3.0]).violations.is_admissible()
    assert Impact.observed(c, [3.1]).violations.energetic == pytest.approx(0.1)
    assert Impact.observed(c, [0.9]).violations.kinematic == pytest.approx(0.1)
    welded = Collision(np.eye(2), [[1.0, 0.0]], [-1.0, -1.0], bilateral_jacobian=[[1.0, -1.0]])
    assert Impact.observed(welded, [1.0, 1.0]).violations.is_admissible()
    assert Impact.observed(welded, [1.0, -1.0]).violations.kinetic == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bilateral_jacobian": [1.0, 0.0]}, "shape"),
        ({"bilateral_jacobian": [[1.0, np.nan]]}, "finite"),
        ({"surface_velocity": [1.0]}, "one entry per contact"),
        ({"post_surface_velocity": [[1.0, 2.0]]}, "one entry per contact"),
        ({"surface_velocity": [np.inf, 0.0]}, "finite"),
    ],
)
def test_wrong_input(options, message):
    c = rod()
    with pytest.raises(InvalidCollisionError, match=message):
        Collision(c.mass_matrix, c.jacobian, c.pre_velocity, **options)


def test_sparse_collisions_have_neither():
    from scipy.sparse import csr_array

    c = balls([1.0, 1.0, 1.0], [1.0, 0.0, 0.0])
    for options in ({"bilateral_jacobian": [[1.0, 0.0, 0.0]]}, {"surface_velocity": [1.0, 0.0]}):
        with pytest.raises(InvalidCollisionError, match="dense"):
            Collision(csr_array(c.mass_matrix), csr_array(c.jacobian), c.pre_velocity, **options)


def test_zeros_are_nothing():
    c = rod()
    same = Collision(
        c.mass_matrix,
        c.jacobian,
        c.pre_velocity,
        bilateral_jacobian=np.zeros((3, 2)),
        surface_velocity=[0.0, 0.0],
        post_surface_velocity=[0.0, 0.0],
    )
    assert same.bilateral_jacobian is None
    assert same.surface_velocity is None
    assert same.post_surface_velocity is None
    np.testing.assert_array_equal(Newton(0.5).resolve(same).post_velocity, Newton(0.5).resolve(c).post_velocity)


def test_contacts_that_constraints_hold_have_no_velocity_but_rounding():
    """Only rounding lets the first contact move; S(v-) exists even if the constraints drift."""
    M = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.2], [0.0, 0.2, 1.5]])
    rows = np.array([[0.3, 0.7, 0.1], [0.2, -0.1, 0.4]])
    J = np.vstack([[0.7, -0.3] @ rows, [1.0, 0.0, -0.4]])
    rng = np.random.default_rng(0)
    for _ in range(100):
        v = rng.normal(size=3)
        v -= J[0] * (J[0] @ v) / (J[0] @ J[0])
        collision = Collision(M, J, v, bilateral_jacobian=rows)
        impact = MaximalDissipation().resolve(collision)
        assert impact.residual < 1e-9
        assert impact.violations.is_admissible()
        assert np.isfinite(collision.admissible_set.project(v)).all()


def opposite_limits(ratio: float, seed: int) -> Collision:
    """Return opposite limits of two coordinates that a third one drives by small ratios; the first closes by drifting.

    To open it the third coordinate would have to move so far that the second limit closes.
    """
    rng = np.random.default_rng(seed)
    A, (a, b) = rng.normal(size=(6, 6)), ratio * rng.uniform(0.5, 1.0, 2)
    unit, velocity = np.eye(6), np.append([-1.0, -2.0 * a, b], rng.normal(size=3))
    driven = np.array([unit[1] - a * unit[0], unit[2] + b * unit[0]])
    return Collision(A @ A.T + 0.1 * np.eye(6), unit[1:3], velocity, bilateral_jacobian=driven)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("ratio", [1.0, 1e-2, 1e-4, 1e-6, 1e-8])
def test_limits_that_constraints_all_but_fix_stay_opposite(ratio, seed):
    c = opposite_limits(ratio, seed)
    with pytest.raises(UnsolvableLawError):
        Moreau(0.0).resolve(c)
    impact = Impact.observed(c, c.pre_velocity + np.random.default_rng(seed).normal(size=6))
    assert impact.impulse @ c.gradient_norms <= 1.001 * impact.intensity
