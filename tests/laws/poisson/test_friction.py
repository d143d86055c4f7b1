"""Poisson's law with friction: both phases, energy, and the limit of vanishing friction."""

import numpy as np
import pytest
from laws.frictional import one_contact, several_contacts
from problems import box
from scenes import compiled

from impactlaw import Collision, Coulomb, Friction, Moreau, Poisson, Stepper
from impactlaw.errors import RestitutionError


def test_slides_all_the_way():
    """A disc: compression (1, -0.2), expansion half of it."""
    rows = Friction([[1, 0, 1]], [0], [0.2])
    impact = Coulomb(Poisson(0.5)).resolve(Collision(np.diag([1, 1, 0.5]), [[0, 1, 0]], [10.0, -1.0, 0], friction=rows))
    np.testing.assert_allclose(impact.post_velocity, [9.7, 0.5, -0.6], rtol=0, atol=1e-9)


def test_expansion_sticks():
    """A slip of 1.2 loses 3 * 0.5 in compression, so it stops there; expansion needs no friction."""
    rows = Friction([[1, 0, 1]], [0], [0.5])
    impact = Coulomb(Poisson(1.0)).resolve(Collision(np.diag([1, 1, 0.5]), [[0, 1, 0]], [1.2, -1.0, 0], friction=rows))
    np.testing.assert_allclose(impact.friction_impulse, [-0.4], rtol=0, atol=1e-9)
    np.testing.assert_allclose(impact.post_velocity, [0.8, 1.0, -0.8], rtol=0, atol=1e-9)


def test_friction_of_expansion_alone():
    """A rod's end, G = [[2, 1], [1, 2]], mu = 0.2: expansion drives slip, which the friction of e Lambda_C opposes."""
    J = np.linalg.cholesky(np.array([[2.0, 1.0], [1.0, 2.0]]))
    c = Collision(np.eye(2), J[:1], np.linalg.solve(J, [-1.0, 0.0]), friction=Friction(J[1:], [0], [0.2]))
    compression = 1.0 / 1.8  # slip is positive: gamma_n' = 2 - 0.2
    impact = Coulomb(Poisson(0.5)).resolve(c)
    np.testing.assert_allclose(impact.impulse, [1.5 * compression], rtol=0, atol=1e-9)
    np.testing.assert_allclose(impact.friction_impulse, [-0.3 * compression], rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_hardly_any_friction_is_poissons_law(seed):
    c = several_contacts(np.random.default_rng([1, seed]), 3)
    e = np.random.default_rng(seed).uniform(size=3)
    smooth = Friction(c.friction.jacobian, c.friction.contact, np.full(6, 1e-9))
    c = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, friction=smooth)
    plain = Poisson(e).resolve(Collision(c.mass_matrix, c.jacobian, c.pre_velocity))
    np.testing.assert_allclose(Coulomb(Poisson(e)).resolve(c).post_velocity, plain.post_velocity, rtol=0, atol=1e-6)


@pytest.mark.parametrize("contacts", [1, 2, 4])
def test_never_creates_energy(contacts):
    for seed in range(150):
        rng = np.random.default_rng([2, contacts, seed])
        c = several_contacts(rng, contacts) if seed % 4 else one_contact(rng)
        e = rng.uniform(size=len(c.labels)) if seed % 3 else np.ones(len(c.labels))
        impact = Coulomb(Poisson(e)).resolve(c)
        assert impact.energy_change <= 1e-10 * c.kinetic_energy
        assert impact.violations.is_admissible(1e-8)


def test_slides_all_the_way_under_the_relaxation():
    """A point mass: compression N - 2 = mu (8 - mu N), so N = 4.8; expansion is half of it, each with friction mu N."""
    c = Collision(np.eye(2), [[0, 1]], [8.0, -2.0], friction=Friction([[1, 0]], [0], [0.5]))
    impact = Coulomb(Poisson(0.5), cone="convex").resolve(c)
    np.testing.assert_allclose(impact.impulse, [7.2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(impact.friction_impulse, [-3.6], rtol=0, atol=1e-9)


@pytest.mark.parametrize("contacts", [1, 2, 4])
def test_impulses_of_the_relaxation_are_in_their_cones(contacts):
    for seed in range(60):
        rng = np.random.default_rng([3, contacts, seed])
        c = several_contacts(rng, contacts) if seed % 4 else one_contact(rng)
        impact = Coulomb(Poisson(rng.uniform(size=len(c.labels))), cone="convex").resolve(c)
        assert impact.violations.is_admissible()
        rubbing = np.zeros(len(c.labels))
        np.add.at(rubbing, c.friction.contact, (impact.friction_impulse / c.friction.coefficient) ** 2)
        assert (np.sqrt(rubbing) <= impact.impulse * (1 + 1e-9) + 1e-9).all()


@pytest.mark.parametrize("options", [{}, {"contact_model": "soft"}, {"scheme": "time-stepping"}])
def test_a_box_slides_under_the_relaxation(options):
    """Event-driven and soft steps refuse outcomes outside the cones: the box lands and slides on."""
    falling = '<body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    model, data = compiled('<geom type="plane" size="9 9 1"/>' + falling, geom='friction="0.3"')
    data.qvel[0] = 3.0
    stepper = Stepper(model, Poisson(0.5), friction="convex", **options)
    seen = 0
    for _ in range(150):
        stepper.step(data)
        for event in stepper.events:
            assert event.impact.violations.is_admissible(1e-8)
            seen += 1
    assert seen


def test_what_expansion_would_penetrate_gets_more():
    """A dead and an elastic contact that act on each other's bodies: in the outcome no contact closes."""
    for seed in range(100):
        rng = np.random.default_rng([3, seed])
        c = several_contacts(rng, 3)
        impact = Coulomb(Poisson([0.0, 1.0, 0.0])).resolve(c)
        assert (impact.post_contact_velocity >= -1e-7 * c.pre_speed * c.gradient_norms).all()
        assert (impact.impulse * c.gradient_norms >= -1e-9 * c.pre_speed).all()


def test_a_box_lands_flat():
    c = box()
    tangential = []
    for row in c.jacobian:
        y, x = row[3], -row[4]
        tangential += [[1, 0, 0, 0, -1, -y], [0, 1, 0, 1, 0, x]]
    rows = Friction(tangential, np.repeat(np.arange(4), 2), np.full(8, 0.1))
    c = Collision(c.mass_matrix, c.jacobian, [2.0, 0.0, -1.0, 0, 0, 0], friction=rows)
    ours, moreau = Coulomb(Poisson(0.5)).resolve(c), Coulomb(Moreau(0.5)).resolve(c)
    assert ours.impulse.sum() == pytest.approx(2.0 * (1 + ours.post_velocity[2]), abs=1e-8)
    assert ours.energy_change < 0 > moreau.energy_change


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}])
def test_a_box_in_rigid_steps(options):
    """A tilted box slides into the floor; energy never grows, and its first collision obeys the law."""
    model, data = compiled(
        '<geom name="floor" type="plane" size="5 5 1"/><body pos="0 0 .3" euler="20 10 0"><freejoint/>'
        '<geom name="box" type="box" size=".1 .15 .05" mass="1"/></body>',
        option='timestep="2e-3"',
        geom='friction=".4" condim="3"',
    )
    data.qvel[:3] = [1.0, 0.3, -1.0]
    law = Poisson(0.6)
    stepper, events = Stepper(model, law, **options), []
    while data.time < 1.0:
        stepper.step(data)
        events += stepper.events
    first = events[0].impact
    expected = Coulomb(law).resolve(first.collision)
    np.testing.assert_allclose(first.post_velocity, expected.post_velocity, rtol=0, atol=1e-6)
    assert all(event.impact.energy_change <= 1e-9 * first.collision.kinetic_energy for event in events)


def test_tangential_restitution_is_refused():
    with pytest.raises(RestitutionError, match="no tangential restitution"):
        Coulomb(Poisson(0.5), tangential_restitution=0.2)


def dependent_rows(rng):
    """Return the arguments of a collision with more rows than degrees of freedom: friction has several solutions."""
    h, kinds, n = int(rng.integers(1, 4)), int(rng.integers(1, 3)), 2
    A, v = rng.normal(size=(n, n)), rng.normal(size=n)
    J, J_t = rng.normal(size=(h, n)), rng.normal(size=(h * kinds, n))
    J *= -np.sign(J @ v)[:, None]
    mu = np.repeat(rng.uniform(0.1, 1.2, h), kinds)
    return A @ A.T + 0.3 * np.eye(n), J, v, Friction(J_t, np.repeat(np.arange(h), kinds), mu)


@pytest.mark.parametrize("cone", ["exact", "convex"])
def test_units_of_mass_and_speed_change_nothing(cone):
    rng, law = np.random.default_rng(11), Coulomb(Poisson(0.5), cone=cone)
    for _ in range(100):
        M, J, v, friction = dependent_rows(rng)
        outcomes = [
            law.resolve(Collision(mass * M, J, speed * v, friction=friction)).post_velocity / speed
            for speed, mass in ((1.0, 1.0), (3.0, 1.0), (0.1, 1.0), (1.0, 7.0), (1.0, 1e3))
        ]
        size = np.linalg.norm(v)
        np.testing.assert_allclose(outcomes[1:], np.broadcast_to(outcomes[0], (4, len(v))), rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("friction", [0.5, 1e-9])
def test_redundant_contacts_in_any_order(friction):
    """A box lands flat on its four corners: the compression impulses of least norm are multiplied by e."""
    e, outcomes = np.array([0.9, 0.5, 0.3, 0.1]), []
    corners = [np.array([x, y, -1.0]) for x in (-1, 1) for y in (-1, 1)]
    for order in ([0, 1, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]):
        rows = [[np.concatenate([d, np.cross(corners[i], d)]) for d in np.eye(3)] for i in order]
        tangents = Friction(np.vstack([row[:2] for row in rows]), np.repeat(range(4), 2), np.full(8, friction))
        mass, velocity = np.diag([1, 1, 1, 2 / 3, 2 / 3, 2 / 3]), [0.3, 0.1, -1.0, 0, 0, 0]
        c = Collision(mass, np.array([row[2] for row in rows]), velocity, friction=tangents)
        outcomes.append(Coulomb(Poisson(e[order])).resolve(c).post_velocity)
    np.testing.assert_allclose(outcomes[1:], [outcomes[0]] * 2, rtol=0, atol=1e-7)
