"""Coulomb friction: exact answers, energy, redundant contacts, the frictionless limit, the relaxation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import LAWS, PROBLEMS, friction_collision

from impactlaw import (
    Collision,
    Coulomb,
    Fremond,
    Friction,
    FrictionImpact,
    Impact,
    MaximalDissipation,
    Moreau,
    Newton,
)
from impactlaw.errors import InvalidCollisionError, RestitutionError, UnknownNameError, UnsolvableLawError
from impactlaw.laws import Law

EXACT = {"rtol": 0, "atol": 1e-12}
CONES = ["exact", "convex"]


def sphere(velocity, mu, *, mass=2.0, radius=0.5, torsion=0.0, rolling=0.0) -> Collision:
    """A solid sphere meets the floor; velocity is (x, y, z, and the angular velocity), the contact is below it."""
    M = np.diag([mass] * 3 + [0.4 * mass * radius**2] * 3)
    r = np.array([0.0, 0.0, -radius])
    point = np.hstack([np.eye(3), -np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])])
    turn = np.hstack([np.zeros((3, 3)), np.eye(3)])
    rows, mus = [point[0], point[1]], [mu, mu]
    if torsion:
        rows, mus = [*rows, turn[2]], [*mus, torsion]
    if rolling:
        rows, mus = [*rows, turn[0], turn[1]], [*mus, rolling, rolling]
    return Collision(M, point[2:], velocity, friction=Friction(np.array(rows), np.zeros(len(rows), dtype=int), mus))


# --- one contact: closed forms ---------------------------------------------------------------------------------------


def test_sphere_slips():
    """Friction is mu Lambda_n all the time: v_x loses mu (1 + e) v_z, and the spin gets what belongs to it."""
    impact = Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], 0.1))
    normal = 2.0 * 1.5 * 2.0
    np.testing.assert_allclose(impact.impulse, [normal], **EXACT)
    np.testing.assert_allclose(impact.friction_impulse, [-0.1 * normal, 0.0], **EXACT)
    spin = 0.5 * 0.1 * normal / (0.4 * 2.0 * 0.25)
    np.testing.assert_allclose(impact.post_velocity, [3.0 - 0.3, 0.0, 1.0, 0.0, spin, 0.0], **EXACT)
    assert impact.post_sliding_velocity[0] > 0


def test_sphere_sticks():
    """The point of contact stops: v_x keeps 5/7, for Lambda_t = 2/7 m v_x < mu Lambda_n."""
    impact = Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], 0.5))
    np.testing.assert_allclose(impact.friction_impulse, [-2.0 * 3.0 * 2 / 7, 0.0], **EXACT)
    np.testing.assert_allclose(impact.post_velocity, [15 / 7, 0.0, 1.0, 0.0, 15 / 7 / 0.5, 0.0], **EXACT)
    np.testing.assert_allclose(impact.post_sliding_velocity, 0.0, **EXACT)


def test_boundary_of_sticking():
    """It sticks from mu = 2/7 v_x / ((1 + e) v_z) on, and not below."""
    critical = 2 / 7 * 3.0 / (1.5 * 2.0)
    for factor, sliding in ((0.999, True), (1.001, False)):
        impact = Coulomb(Moreau(0.5)).resolve(sphere([3.0, 0.0, -2.0, 0, 0, 0], factor * critical))
        assert bool(abs(impact.post_sliding_velocity[0]) > 1e-6) is sliding


def test_superball_reverses():
    """e = e_t = 1: the point of contact comes back with -v_x, v_x keeps 3/7, and the energy is the same."""
    c = sphere([3.0, 0.0, -2.0, 0, 0, 0], 2.0)
    impact = Coulomb(Moreau(1.0), tangential_restitution=1.0).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [9 / 7, 0, 2.0, 0, 10 / 7 * 3.0 / 0.5, 0], **EXACT)
    np.testing.assert_allclose(impact.post_sliding_velocity, [-3.0, 0.0], **EXACT)
    assert abs(impact.energy_change) < 1e-12 * c.kinetic_energy
    assert impact.restitution_scale == 1.0


def test_tangential_restitution_within_the_cone():
    """Lambda_t would be 2/7 (1 + e_t) m v_x; where that is more than mu Lambda_n it is mu Lambda_n."""
    for e_t, mu, expected in ((0.5, 1.0, 2 / 7 * 1.5 * 2.0 * 3.0), (1.0, 0.3, 0.3 * 6.0)):
        impact = Coulomb(Moreau(0.5), tangential_restitution=e_t).resolve(sphere([3.0, 0, -2.0, 0, 0, 0], mu))
        np.testing.assert_allclose(impact.friction_impulse[0], -expected, **EXACT)


def test_spinning_ball_is_driven():
    """Top spin without speed: friction accelerates it to 2/7 r w, where it rolls."""
    impact = Coulomb(MaximalDissipation()).resolve(sphere([0, 0, -2.0, 0, 30.0, 0], 3.0))
    np.testing.assert_allclose(impact.post_velocity, [2 / 7 * 0.5 * 30, 0, 0, 0, 2 / 7 * 30.0, 0], **EXACT)


@pytest.mark.parametrize(("torsion", "spin"), [(0.01, 5.0 - 0.01 * 4.0 / 0.2), (0.5, 0.0)])
def test_torsion(torsion, spin):
    """Spin about the normal loses mu_3 Lambda_n / I, or all of it; I = 2/5 m r^2 = 0.2, Lambda_n = 4."""
    impact = Coulomb(MaximalDissipation()).resolve(sphere([0, 0, -2.0, 0, 0, 5.0], 1.0, torsion=torsion))
    np.testing.assert_allclose(impact.post_velocity, [0, 0, 0, 0, 0, spin], **EXACT)


def test_rolling_resistance():
    """A rolling ball: the moment of resistance and the friction that keeps it rolling share the cone.

    With ``v = r w``, Lambda_t = (f, tau): m dv = f, I dw = -r f + tau, and rolling on, dv = r dw, gives
    ``tau = (I + m r^2) dv / r``, so that f/tau = m r / (I + m r^2).
    """
    m, r, mu, rolling = 2.0, 0.5, 1.0, 0.02
    c = sphere([1.0, 0, -2.0, 0, 2.0, 0], mu, torsion=1e-3, rolling=rolling)
    impact = Coulomb(MaximalDissipation()).resolve(c)
    inertia = 0.4 * m * r**2
    ratio = m * r / (inertia + m * r**2)
    f, tau = impact.friction_impulse[0], impact.friction_impulse[4]
    assert (f / mu) ** 2 + (tau / rolling) ** 2 == pytest.approx(impact.impulse[0] ** 2, rel=1e-12)
    # sliding is opposed in the ratio of the cone: u_slip mu : u_roll rolling = f / mu : tau / rolling
    slip, roll = impact.post_sliding_velocity[[0, 4]]
    assert mu * slip * tau / rolling == pytest.approx(rolling * roll * f / mu, abs=1e-12)
    assert abs(f) < abs(ratio * tau)  # it slips a little, since that dissipates more
    strong = Coulomb(MaximalDissipation()).resolve(sphere([1.0, 0, -2.0, 0, 2.0, 0], mu, torsion=1.0, rolling=1.0))
    np.testing.assert_allclose(strong.post_velocity, 0.0, **EXACT)
    np.testing.assert_allclose(strong.friction_impulse[[0, 4]], [-2.0, -(inertia + m * r**2) / r], **EXACT)


@pytest.mark.parametrize(("mu", "moves"), [(np.tan(0.3) * 0.99, True), (np.tan(0.3) * 1.01, False)])
def test_block_on_an_incline(mu, moves):
    """What gravity gives it in a time dt along a slope of angle 0.3 is taken by friction if mu >= tan 0.3."""
    g = 9.81 * 0.01
    v = [g * np.sin(0.3), 0.0, -g * np.cos(0.3)]
    c = Collision(2.0 * np.eye(3), [[0, 0, 1.0]], v, friction=Friction(np.eye(3)[:2], [0, 0], [mu, mu]))
    impact = Coulomb(MaximalDissipation()).resolve(c)
    along = g * (np.sin(0.3) - mu * np.cos(0.3)) if moves else 0.0
    np.testing.assert_allclose(impact.post_velocity, [along, 0.0, 0.0], **EXACT)


@pytest.mark.parametrize("mu", [0.2, 4 / 3, 1.5, 2.5, 50.0])
def test_rod_on_one_end(mu):
    """Painlevé: a uniform rod, m = 1, length 2, at 60 degrees, slides on its lower end, which also approaches.

    With the lower end at (-cos a, -sin a) from the middle: G_nn = 1 + 3 cos^2 a, G_tt = 1 + 3 sin^2 a, and
    G_nt = -3 sin a cos a, so that friction against sliding presses the end down for mu > G_nn / |G_nt|, 1.347.
    At the level of velocities there is a solution for every mu; where G_nn - mu |G_nt| <= 0 the end cannot go on
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
    else:  # slides on to the left: Lambda_t = mu Lambda_n
        normal = 0.1 / (G[0, 0] + mu * G[0, 1])
        np.testing.assert_allclose([impact.impulse[0], impact.friction_impulse[0]], [normal, mu * normal], **EXACT)
        assert impact.post_sliding_velocity[0] < 0
    assert impact.energy_change < 0
    assert impact.residual < 1e-12


def test_convex_relaxation_lifts_what_slides():
    """Anitescu's relaxation: u_n = mu |u_t| where a contact slides."""
    impact = Coulomb(MaximalDissipation(), cone="convex").resolve(sphere([3.0, 0, -2.0, 0, 0, 0], 0.1))
    assert impact.post_contact_velocity[0] == pytest.approx(0.1 * np.linalg.norm(impact.post_sliding_velocity))
    assert impact.post_contact_velocity[0] > 0.1
    assert impact.violations.is_admissible()


def test_moving_belt():
    """A ball at rest is set down on a belt that runs at 1: it is taken along, and the belt does the work."""
    c = sphere([0, 0, -1.0, 0, 0, 0], 2.0)
    belt = Friction(c.friction.jacobian, [0, 0], [2.0, 2.0], [-1.0, 0.0])
    c = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, friction=belt)
    impact = Coulomb(MaximalDissipation()).resolve(c)
    np.testing.assert_allclose(impact.post_velocity[:3], [2 / 7, 0.0, 0.0], **EXACT)
    np.testing.assert_allclose(impact.surface_work, impact.friction_impulse[0] * 1.0, **EXACT)
    assert impact.work < 0
    assert impact.violations.is_admissible()


# --- energy ----------------------------------------------------------------------------------------------------------


def kane() -> Collision:
    """A rod meets the floor obliquely, sliding: Newton's restitution with friction creates energy (Kane 1984)."""
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
    assert more.restitution_scale < 1.0  # a little more would create some
    assert Coulomb(Newton(0.99 * impact.restitution_scale)).resolve(c).restitution_scale == 1.0


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), e=st.floats(0, 1), e_t=st.floats(0, 1), cone=st.sampled_from(CONES))
def test_random_collisions(seed, e, e_t, cone):
    c = friction_collision(np.random.default_rng(seed), most=6)
    impact = Coulomb(Newton(e), tangential_restitution=e_t, cone=cone).resolve(c)
    assert impact.residual < 1e-9
    if not isinstance(impact, FrictionImpact):  # no contact has friction
        return
    violations = impact.violations
    assert violations.kinetic <= 1e-9 * c.pre_speed
    assert violations.energetic <= 1e-9 * c.pre_speed
    if (impact.target_contact_velocity >= 0).all():  # else a contact that separates is allowed to come back
        assert violations.is_admissible()
    assert impact.work <= 1e-9 * max(c.pre_speed, impact.intensity) ** 2
    for i in range(len(c.labels)):
        rows = c.friction.contact == i
        along = np.linalg.norm(impact.friction_impulse[rows] / c.friction.coefficient[rows])
        assert along <= impact.impulse[i] * (1 + 1e-9) + 1e-9 * impact.impulse.max()


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", PROBLEMS)
def test_without_friction_it_is_the_inner_law(law, name, cone):
    c = PROBLEMS[name]()
    inner = LAWS[law](c)
    if not inner.has_target:  # Poisson's
        with pytest.raises(RestitutionError, match="has a rule of its own"):
            Coulomb(inner)
        return
    try:
        expected = inner.resolve(c)
    except Exception as error:
        with pytest.raises(type(error)):
            Coulomb(inner, cone=cone).resolve(c)
        return
    impact = Coulomb(inner, tangential_restitution=0.3, cone=cone).resolve(c)
    np.testing.assert_array_equal(impact.post_velocity, expected.post_velocity)


@pytest.mark.parametrize("seed", range(25))
def test_frictionless_limit(seed):
    """Coefficients of 1e-12: the outcome is that of the inner law to 1e-10."""
    c = friction_collision(np.random.default_rng(seed), ratio=10.0)
    f = c.friction
    slick = Friction(f.jacobian, f.contact, np.full(len(f), 1e-12))
    c = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, friction=slick)
    for law in (MaximalDissipation(), Moreau(0.7)):
        difference = Coulomb(law).resolve(c).post_velocity - law.resolve(c).post_velocity
        assert c.metric.norm(difference) < 1e-10 * c.pre_speed


def test_four_corners_share():
    """A box that slides on its four corners: redundant contacts, the energy of a sliding point, equal shares."""
    corners = [(-1, -1), (1, -1), (-1, 1), (1, 1)]
    J = np.array([[0, 0, 1.0, y, -x, 0] for x, y in corners])
    # the friction acts at the height of the centre, so that nothing turns
    T = np.vstack([[[1.0, 0, 0, 0, 0, -y], [0, 1.0, 0, 0, 0, x]] for x, y in corners])
    c = Collision(
        np.diag([2.0] * 3 + [4 / 3] * 3),
        J,
        [0.6, 0.0, -1.0, 0, 0, 0],
        friction=Friction(T, np.repeat(range(4), 2), [0.25] * 8),
    )
    impact = Coulomb(Moreau(0.5)).resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [0.6 - 0.25 * 1.5, 0, 0.5, 0, 0, 0], **EXACT)
    np.testing.assert_allclose(impact.impulse, 0.25 * 2.0 * 1.5, **EXACT)


def test_surfaces_that_crush_a_body_are_refused():
    c = Collision(
        np.eye(2),
        [[0.0, 1.0], [0.0, -1.0]],
        [1.0, 0.0],
        surface_velocity=[-1.0, -1.0],
        friction=Friction([[1.0, 0.0]], [0], [0.5]),
        labels=("press", "anvil"),
    )
    with pytest.raises(UnsolvableLawError, match="press, anvil"):
        Coulomb(MaximalDissipation()).resolve(c)


def test_ball_between_two_walls_bounces_off_one():
    """gamma- = (-1, 1): the wall it leaves gives no impulse, and so no friction."""
    c = Collision(
        np.eye(2), [[0.0, 1.0], [0.0, -1.0]], [1.0, -1.0], friction=Friction([[1.0, 0]] * 2, [0, 1], [0.3, 0.3])
    )
    impact = Coulomb(Moreau(0.5)).resolve(c)
    np.testing.assert_allclose(impact.post_contact_velocity, [0.5, -0.5], **EXACT)
    np.testing.assert_allclose(impact.friction_impulse, [-0.3 * 1.5, 0.0], **EXACT)


# --- observed outcomes, interface ------------------------------------------------------------------------------------


def test_observed():
    c = sphere([3.0, 0.0, -2.0, 0, 0, 0], 0.1)
    decided = Coulomb(Moreau(0.5)).resolve(c)
    seen = FrictionImpact.observed(c, decided.post_velocity)
    np.testing.assert_allclose(seen.friction_impulse, decided.friction_impulse, **EXACT)
    assert seen.violations.is_admissible()
    assert Impact.observed(c, decided.post_velocity).violations.kinetic > 0.1  # without friction it is a mystery
    pulled = FrictionImpact.observed(c, [3.0 - 1.0, 0.0, 0.0, 0, 5 / 2 / 0.5, 0])
    assert pulled.violations.kinetic == pytest.approx(0.8 * np.sqrt(7.0) / np.sqrt(1 + 0.01 * 3.5), abs=0.1)
    with pytest.raises(InvalidCollisionError, match="no friction"):
        FrictionImpact.observed(PROBLEMS["rod"](), [0.0, 0.0])


def test_select():
    f = Friction(np.arange(12.0).reshape(4, 3), [0, 0, 2, 3], [1.0, 2.0, 3.0, 4.0], [0.1, 0.2, 0.3, 0.4])
    part = f.select([3, 1, 0])
    assert part is not None
    np.testing.assert_array_equal(part.contact, [0, 2, 2])
    np.testing.assert_array_equal(part.coefficient, [4.0, 1.0, 2.0])
    np.testing.assert_array_equal(part.jacobian[0], [9.0, 10.0, 11.0])
    np.testing.assert_array_equal(part.post_surface_velocity, [0.4, 0.1, 0.2])
    assert f.select([1]) is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[1.0, 0, 0]], [0], [0.0]), "must be positive"),
        (([[1.0, 0, 0]], [0], [np.nan]), "not finite"),
        (([[1.0, 0, 0]], [0, 1], [1.0]), "integers"),
        (([[1.0, 0, 0]] * 2, [1, 0], [1.0, 1.0]), "ascending"),
        (([[1.0, 0, 0]], [0.5], [1.0]), "integers"),
        (([1.0, 0, 0], [0], [1.0]), "shape"),
        (([[1.0, 0, 0]], [0], [1.0], [1.0, 2.0]), "surface_velocity"),
    ],
)
def test_invalid_friction(arguments, message):
    with pytest.raises(InvalidCollisionError, match=message):
        Friction(*arguments)


def test_friction_must_fit_the_collision():
    with pytest.raises(InvalidCollisionError, match="columns"):
        Collision(np.eye(2), [[1.0, 0.0]], [0.0, 0.0], friction=Friction([[1.0, 0, 0]], [0], [1.0]))
    with pytest.raises(InvalidCollisionError, match="there are 1"):
        Collision(np.eye(2), [[1.0, 0.0]], [0.0, 0.0], friction=Friction([[1.0, 0]], [1], [1.0]))


def test_refusals():
    with pytest.raises(RestitutionError, match="tangential"):
        Coulomb(Moreau(0.5), tangential_restitution=1.5)
    with pytest.raises(RestitutionError, match="extends a law"):
        Coulomb("moreau")  # pyright: ignore[reportArgumentType]
    with pytest.raises(UnknownNameError, match="cone"):
        Coulomb(Moreau(0.5), cone="pyramid")  # pyright: ignore[reportArgumentType]

    class Own(Law):
        def target(self, collision):
            return Moreau(0.0).target(collision)

        def resolve(self, collision, *, solver="auto"):
            return Moreau(0.0).resolve(collision, solver=solver)

    with pytest.raises(RestitutionError, match="Own has a rule"):
        Coulomb(Own())
    with pytest.raises(RestitutionError, match="Coulomb has a rule"):
        Coulomb(Coulomb(Moreau(0.5)))


def test_labels_of_the_inner_law():
    assert Coulomb(Newton({"a/b": 0.5})).contact_labels == {"a/b"}
    assert Coulomb(Fremond({("a/b", "b/c"): 0.5})).contact_labels == {"a/b", "b/c"}
    assert Coulomb(Moreau(0.5)).contact_labels == frozenset()


def test_violations_are_compared_with_the_speed_of_the_surface_that_slides_below():
    """A body that all but rests on a belt of 1 m/s: what is rounding of the belt's speed is no violation."""
    belt = Friction([[1, 0, 0]], [0], [0.5], surface_velocity=[-1.0])
    collision = Collision(np.eye(3), [[0, 1, 0]], [0, -5e-9, 0], friction=belt)
    after = Coulomb(Moreau(0.3)).resolve(collision).post_velocity
    for aside, admissible in ((3e-13, True), (3e-8, False)):
        impact = FrictionImpact.observed(collision, after + np.array([0, 0, aside]))
        assert impact.violations.kinetic == pytest.approx(aside, rel=1e-2)
        assert impact.violations.is_admissible() == admissible
