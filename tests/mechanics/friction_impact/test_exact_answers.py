"""Coulomb friction: exact answers of single bodies."""

import numpy as np
import pytest
from mechanics.friction_impact.bodies import sphere

from impactlaw import (
    Collision,
    Coulomb,
    Friction,
    FrictionImpact,
    MaximalDissipation,
    Moreau,
    Newton,
)
from impactlaw.errors import SolverError

EXACT = {"rtol": 0, "atol": 1e-12}


def test_sphere_slips():
    """Friction is mu Lambda_n throughout: v_x loses mu (1 + e) v_z, and the spin gets the corresponding share."""
    impact = Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], 0.1))
    normal = 2.0 * 1.5 * 2.0
    np.testing.assert_allclose(impact.impulse, [normal], **EXACT)
    np.testing.assert_allclose(impact.friction_impulse, [-0.1 * normal, 0.0], **EXACT)
    spin = 0.5 * 0.1 * normal / (0.4 * 2.0 * 0.25)
    np.testing.assert_allclose(impact.post_velocity, [3.0 - 0.3, 0.0, 1.0, 0.0, spin, 0.0], **EXACT)
    assert impact.post_sliding_velocity[0] > 0


def test_sphere_sticks():
    """The contact point stops: v_x keeps 5/7, because Lambda_t = 2/7 m v_x < mu Lambda_n."""
    impact = Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], 0.5))
    np.testing.assert_allclose(impact.friction_impulse, [-2.0 * 3.0 * 2 / 7, 0.0], **EXACT)
    np.testing.assert_allclose(impact.post_velocity, [15 / 7, 0.0, 1.0, 0.0, 15 / 7 / 0.5, 0.0], **EXACT)
    np.testing.assert_allclose(impact.post_sliding_velocity, 0.0, **EXACT)


def test_boundary_of_sticking():
    """It sticks for mu >= 2/7 v_x / ((1 + e) v_z), and slips below."""
    critical = 2 / 7 * 3.0 / (1.5 * 2.0)
    for factor, sliding in ((0.999, True), (1.001, False)):
        impact = Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], factor * critical))
        assert bool(abs(impact.post_sliding_velocity[0]) > 1e-6) is sliding


@pytest.mark.parametrize("mu", [1e2, 1e4, 1e8])
def test_large_coefficients_make_it_stick(mu):
    impact = Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], mu))
    np.testing.assert_allclose(impact.post_velocity, [15 / 7, 0.0, 1.0, 0.0, 15 / 7 / 0.5, 0.0], **EXACT)


@pytest.mark.parametrize("mu", [1e12, 1e15])
def test_coefficients_that_hide_the_normal_are_refused(mu):
    """Regression: the gap gradient was taken for rounding, and the sphere slid on as if without friction."""
    with pytest.raises(SolverError, match="coefficients of friction of contacts 0 are too large"):
        Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], mu))


def test_superball_reverses():
    """e = e_t = 1: the contact point returns with -v_x, v_x keeps 3/7, and energy is conserved."""
    c = sphere([3.0, 0.0, -2.0, 0, 0, 0], 2.0)
    impact = Coulomb(Moreau(1.0), tangential_restitution=1.0).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [9 / 7, 0, 2.0, 0, 10 / 7 * 3.0 / 0.5, 0], **EXACT)
    np.testing.assert_allclose(impact.post_sliding_velocity, [-3.0, 0.0], **EXACT)
    assert abs(impact.energy_change) < 1e-12 * c.kinetic_energy
    assert impact.restitution_scale == 1.0


def test_tangential_restitution_within_the_cone():
    """Lambda_t would be 2/7 (1 + e_t) m v_x; it is limited to mu Lambda_n."""
    for e_t, mu, expected in ((0.5, 1.0, 2 / 7 * 1.5 * 2.0 * 3.0), (1.0, 0.3, 0.3 * 6.0)):
        impact = Coulomb(Moreau(0.5), tangential_restitution=e_t).resolve(sphere([3.0, 0, -2.0, 0, 0, 0], mu))
        np.testing.assert_allclose(impact.friction_impulse[0], -expected, **EXACT)


def test_spinning_ball_is_driven():
    """Top spin without speed: friction accelerates the ball to 2/7 r w, where it rolls."""
    impact = Coulomb(MaximalDissipation()).resolve(sphere([0, 0, -2.0, 0, 30.0, 0], 3.0))
    np.testing.assert_allclose(impact.post_velocity, [2 / 7 * 0.5 * 30, 0, 0, 0, 2 / 7 * 30.0, 0], **EXACT)


@pytest.mark.parametrize(("torsion", "spin"), [(0.01, 5.0 - 0.01 * 4.0 / 0.2), (0.5, 0.0)])
def test_torsion(torsion, spin):
    """Spin about the normal loses mu_3 Lambda_n / I, or all of it; I = 2/5 m r^2 = 0.2, Lambda_n = 4."""
    impact = Coulomb(MaximalDissipation()).resolve(sphere([0, 0, -2.0, 0, 0, 5.0], 1.0, torsion=torsion))
    np.testing.assert_allclose(impact.post_velocity, [0, 0, 0, 0, 0, spin], **EXACT)


def test_rolling_resistance():
    """A rolling ball: the moment of rolling resistance and the friction that keeps it rolling share the cone.

    With ``v = r w``, Lambda_t = (f, tau): m dv = f, I dw = -r f + tau, and while it rolls, dv = r dw. This gives
    ``tau = (I + m r^2) dv / r``, so that f/tau = m r / (I + m r^2).
    """
    m, r, mu, rolling = 2.0, 0.5, 1.0, 0.02
    c = sphere([1.0, 0, -2.0, 0, 2.0, 0], mu, torsion=1e-3, rolling=rolling)
    impact = Coulomb(MaximalDissipation()).resolve(c)
    inertia = 0.4 * m * r**2
    ratio = m * r / (inertia + m * r**2)
    f, tau = impact.friction_impulse[0], impact.friction_impulse[4]
    assert (f / mu) ** 2 + (tau / rolling) ** 2 == pytest.approx(impact.impulse[0] ** 2, rel=1e-12)
    # slip is opposed in the ratio of the cone: u_slip mu : u_roll rolling = f / mu : tau / rolling
    slip, roll = impact.post_sliding_velocity[[0, 4]]
    assert mu * slip * tau / rolling == pytest.approx(rolling * roll * f / mu, abs=1e-12)
    assert abs(f) < abs(ratio * tau)  # it slips slightly, because this dissipates more
    strong = Coulomb(MaximalDissipation()).resolve(sphere([1.0, 0, -2.0, 0, 2.0, 0], mu, torsion=1.0, rolling=1.0))
    np.testing.assert_allclose(strong.post_velocity, 0.0, **EXACT)
    np.testing.assert_allclose(strong.friction_impulse[[0, 4]], [-2.0, -(inertia + m * r**2) / r], **EXACT)


@pytest.mark.parametrize(("mu", "moves"), [(np.tan(0.3) * 0.99, True), (np.tan(0.3) * 1.01, False)])
def test_block_on_an_incline(mu, moves):
    """Friction cancels the velocity that gravity adds in dt on a slope of 0.3 rad if mu >= tan 0.3."""
    g = 9.81 * 0.01
    v = [g * np.sin(0.3), 0.0, -g * np.cos(0.3)]
    c = Collision(2.0 * np.eye(3), [[0, 0, 1.0]], v, friction=Friction(np.eye(3)[:2], [0, 0], [mu, mu]))
    impact = Coulomb(MaximalDissipation()).resolve(c)
    along = g * (np.sin(0.3) - mu * np.cos(0.3)) if moves else 0.0
    np.testing.assert_allclose(impact.post_velocity, [along, 0.0, 0.0], **EXACT)


@pytest.mark.parametrize("mu", [0.2, 4 / 3, 1.5, 2.5, 50.0])
def test_rod_on_one_end(mu):
    """Painlevé: a uniform rod, m = 1, length 2, at 60 degrees, slides on its lower end, which also closes.

    With the lower end at (-cos a, -sin a) from the middle: G_nn = 1 + 3 cos^2 a, G_tt = 1 + 3 sin^2 a, and
    G_nt = -3 sin a cos a, so that friction against sliding presses the end down for mu > G_nn / |G_nt|, 1.347.
    At the level of velocities there is a solution for every mu. Where G_nn - mu |G_nt| <= 0 the end cannot keep
    sliding: it sticks, with impulses G^-1 gamma-.
    """
    a = np.pi / 3
    r = np.array([-np.cos(a), -np.sin(a)])
    c = Collision(
        np.diag([1.0, 1.0, 1.0 / 3.0]),
        [[0.0, 1.0, r[0]]],
        [-1.0, -0.1, 0.0],
        friction=Friction([[1.0, 0.0, -r[1]]], [0], [mu]),
    )
    G = np.array(
        [[1 + 3 * np.cos(a) ** 2, -3 * np.sin(a) * np.cos(a)], [-3 * np.sin(a) * np.cos(a), 1 + 3 * np.sin(a) ** 2]]
    )
    np.testing.assert_allclose(np.vstack([c.whitened_jacobian, c.whitened_friction]) @ c.whitened_jacobian.T, G[:, :1])
    impact = Coulomb(MaximalDissipation()).resolve(c)
    stuck = np.linalg.solve(G, [0.1, 1.0])
    if abs(stuck[1]) <= mu * stuck[0]:
        np.testing.assert_allclose([impact.impulse[0], impact.friction_impulse[0]], stuck, **EXACT)
    else:  # it keeps sliding to the left: Lambda_t = mu Lambda_n
        normal = 0.1 / (G[0, 0] + mu * G[0, 1])
        np.testing.assert_allclose([impact.impulse[0], impact.friction_impulse[0]], [normal, mu * normal], **EXACT)
        assert impact.post_sliding_velocity[0] < 0
    assert impact.energy_change < 0
    assert impact.residual < 1e-12


def test_convex_relaxation_lifts_what_slides():
    """Anitescu's relaxation: u_n = mu |u_t| at a sliding contact."""
    impact = Coulomb(MaximalDissipation(), cone="convex").resolve(sphere([3.0, 0, -2.0, 0, 0, 0], 0.1))
    assert impact.post_contact_velocity[0] == pytest.approx(0.1 * np.linalg.norm(impact.post_sliding_velocity))
    assert impact.post_contact_velocity[0] > 0.1
    assert impact.violations.is_admissible()


def test_moving_belt():
    """A ball at rest is put on a belt that runs at 1: it is taken along, and the belt does the work."""
    c = sphere([0, 0, -1.0, 0, 0, 0], 2.0)
    belt = Friction(c.friction.jacobian, [0, 0], [2.0, 2.0], [-1.0, 0.0])
    c = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, friction=belt)
    impact = Coulomb(MaximalDissipation()).resolve(c)
    np.testing.assert_allclose(impact.post_velocity[:3], [2 / 7, 0.0, 0.0], **EXACT)
    np.testing.assert_allclose(impact.surface_work, impact.friction_impulse[0] * 1.0, **EXACT)
    assert impact.work < 0
    assert impact.violations.is_admissible()


def kane() -> Collision:
    """Return a rod that hits the floor obliquely while sliding: Newton's law with friction gains energy (Kane 1984)."""
    a = 0.9
    r = np.array([-np.cos(a), -np.sin(a)])
    friction = Friction([[1.0, 0.0, -r[1]]], [0], [0.7])
    return Collision(np.diag([1.0, 1.0, 1.0 / 3.0]), [[0.0, 1.0, r[0]]], [1.0, -1.0, 0.0], friction=friction)


def test_newton_with_friction_would_create_energy():
    c = kane()
    impact = Coulomb(Newton(1.0)).resolve(c)
    assert 0.0 < impact.restitution_scale < 1.0
    assert -1e-9 * c.kinetic_energy < impact.energy_change <= 1e-11 * c.kinetic_energy
    np.testing.assert_allclose(
        impact.post_contact_velocity, -impact.restitution_scale * c.pre_contact_velocity, rtol=0, atol=1e-10
    )
    more = Coulomb(Newton(min(1.0, 1.01 * impact.restitution_scale))).resolve(c)
    assert more.restitution_scale < 1.0  # with more, energy would be created
    assert Coulomb(Newton(0.99 * impact.restitution_scale)).resolve(c).restitution_scale == 1.0


def test_a_solution_far_from_the_guess_is_found():
    """In the solution the first contact opens and the second sticks; from rest the solver ends where no body moves."""
    friction = Friction(
        [[-0.42, -1.74, -0.79], [2.17, 0.6, 2.18], [-1.51, 0.81, -0.68], [-0.12, 1.74, -0.66]],
        [0, 0, 1, 1],
        [0.74, 0.74, 0.64, 0.64],
    )
    mass = [[1.43, -1.11, 1.77], [-1.11, 8.78, -0.06], [1.77, -0.06, 3.08]]
    normals = [[0.12, -0.25, -0.18], [0.46, -1.34, 0.33]]
    collision = Collision(mass, normals, [2.4, 2.47, 3.8], friction=friction)
    impact = Coulomb(Moreau(0.96)).resolve(collision)
    assert impact.restitution_scale == 1.0
    first, second = impact.post_contact_velocity
    assert second == pytest.approx(-0.96 * collision.pre_contact_velocity[1], rel=1e-9)
    assert first >= -0.96 * collision.pre_contact_velocity[0] - 1e-9
    assert impact.energy_change < 0.0
    assert impact.residual < 1e-9
    assert FrictionImpact.observed(collision, impact.post_velocity).violations.is_admissible(1e-8)


@pytest.mark.parametrize("mu", [3e9, 9e9])
def test_coefficients_that_hide_where_a_box_is_going_are_refused(mu):
    """Regression: it passed through the floor, because in units of friction its four corners had stopped."""
    corners = [np.array([x, y, -1.0]) for x in (-1, 1) for y in (-1, 1)]
    rows = [[np.concatenate([d, np.cross(r, d)]) for d in np.eye(3)] for r in corners]
    friction = Friction(np.vstack([row[:2] for row in rows]), np.repeat(range(4), 2), np.full(8, mu))
    mass, velocity = np.diag([1, 1, 1, 2 / 3, 2 / 3, 2 / 3]), [0.0, 0.0, -0.5, 0.1, 0.1, 0]
    c = Collision(mass, np.array([row[2] for row in rows]), velocity, friction=friction)
    with pytest.raises(SolverError, match=r"friction( cones)? of contacts .* (are too large|were found)"):
        Coulomb(Moreau(0.0)).resolve(c)
