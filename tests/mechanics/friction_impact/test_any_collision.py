"""Coulomb friction in random collisions: energy, redundant contacts, the limit without friction."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laws.frictional import friction_collision
from problems import LAWS, PROBLEMS

from impactlaw import (
    Collision,
    Coulomb,
    Friction,
    FrictionImpact,
    MaximalDissipation,
    Moreau,
    Newton,
    Poisson,
)
from impactlaw.errors import RestitutionError, UnsolvableLawError

EXACT = {"rtol": 0, "atol": 1e-12}
CONES = ["exact", "convex"]


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
    if (impact.target_contact_velocity >= 0).all():  # otherwise a contact that separates may return
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
    along = 0.3
    if isinstance(inner, Poisson):
        with pytest.raises(RestitutionError, match="no tangential restitution"):
            Coulomb(inner, tangential_restitution=along)
        along = 0.0
    elif not inner.has_target:  # Routh's law
        with pytest.raises(RestitutionError, match="has a rule of its own"):
            Coulomb(inner)
        return
    try:
        expected = inner.resolve(c)
    except Exception as error:
        with pytest.raises(type(error)):
            Coulomb(inner, cone=cone).resolve(c)
        return
    impact = Coulomb(inner, tangential_restitution=along, cone=cone).resolve(c)
    np.testing.assert_array_equal(impact.post_velocity, expected.post_velocity)


@pytest.mark.parametrize("seed", range(25))
def test_frictionless_limit(seed):
    """With coefficients of 1e-12, the outcome is that of the inner law to 1e-10."""
    c = friction_collision(np.random.default_rng(seed), ratio=10.0)
    f = c.friction
    slick = Friction(f.jacobian, f.contact, np.full(len(f), 1e-12))
    c = Collision(c.mass_matrix, c.jacobian, c.pre_velocity, friction=slick)
    for law in (MaximalDissipation(), Moreau(0.7)):
        difference = Coulomb(law).resolve(c).post_velocity - law.resolve(c).post_velocity
        assert c.metric.norm(difference) < 1e-10 * c.pre_speed


def test_four_corners_share():
    """A box slides on its four corners: redundant contacts share equally, with the energy of a sliding point."""
    corners = [(-1, -1), (1, -1), (-1, 1), (1, 1)]
    J = np.array([[0, 0, 1.0, y, -x, 0] for x, y in corners])
    # friction acts at the height of the centre, so that the box does not turn
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
    """gamma- = (-1, 1): the wall that it leaves gives no impulse, and therefore no friction."""
    c = Collision(
        np.eye(2), [[0.0, 1.0], [0.0, -1.0]], [1.0, -1.0], friction=Friction([[1.0, 0]] * 2, [0, 1], [0.3, 0.3])
    )
    impact = Coulomb(Moreau(0.5)).resolve(c)
    np.testing.assert_allclose(impact.post_contact_velocity, [0.5, -0.5], **EXACT)
    np.testing.assert_allclose(impact.friction_impulse, [-0.3 * 1.5, 0.0], **EXACT)
