"""Two simultaneous collisions with friction that cannot influence each other have separate outcomes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from laws.frictional import several_contacts

from impactlaw import Collision, Coulomb, Fremond, Friction, FrictionImpact, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.laws.friction.groups import apart, ties_of
from impactlaw.stepping.collisions import as_closed


def _collision(seed: int, rough: float) -> Collision:
    """Return two or three contacts, with coefficients of friction up to 1.5 times a factor."""
    rng = np.random.default_rng(seed)
    c = several_contacts(rng, int(rng.integers(2, 4)), 1)
    f = c.friction
    assert f is not None
    return Collision(
        c.mass_matrix, c.jacobian, c.pre_velocity, friction=Friction(f.jacobian, f.contact, rough * f.coefficient)
    )


def _both(one: Collision, other: Collision) -> tuple[Collision, np.ndarray]:
    """Return both as one collision with interleaved contacts, and the order of the contacts in it."""
    assert one.friction is not None
    assert other.friction is not None
    h = len(one.labels) + len(other.labels)
    order = np.argsort(np.concatenate([np.arange(len(one.labels)), np.arange(len(other.labels)) + 0.5]))
    jacobian = scipy.linalg.block_diag(one.jacobian, other.jacobian)[order]
    along = scipy.linalg.block_diag(one.friction.jacobian, other.friction.jacobian)[order]  # one row per contact
    coefficient = np.concatenate([one.friction.coefficient, other.friction.coefficient])[order]
    M = scipy.linalg.block_diag(one.mass_matrix, other.mass_matrix)
    v = np.concatenate([one.pre_velocity, other.pre_velocity])
    return Collision(M, jacobian, v, friction=Friction(along, np.arange(h), coefficient)), order


def _resolved(law: Coulomb, collision: Collision) -> FrictionImpact:
    impact = law.resolve(collision)
    assert isinstance(impact, FrictionImpact)
    return impact


@pytest.mark.parametrize("cone", ["exact", "convex"])
def test_newtons_law(cone: str):
    scaled = []
    for seed in range(60):
        one, other = _collision(seed, 0.5), _collision(seed + 1000, 0.5)  # others may have several solutions
        c, order = _both(one, other)
        law = Coulomb(Newton(1.0), tangential_restitution=0.2, cone=cone)  # pyright: ignore[reportArgumentType]
        parts, both = [_resolved(law, part) for part in (one, other)], _resolved(law, c)
        scales = [part.restitution_scale for part in parts]
        scaled.append(sum(scale < 1.0 for scale in scales))
        alone = np.concatenate([part.post_velocity for part in parts])
        np.testing.assert_allclose(both.post_velocity, alone, atol=1e-6 * c.pre_speed)
        assert both.restitution_scale == pytest.approx(min(scales), abs=1e-6)
        assert both.target_contact_velocity is not None
        target = np.concatenate([part.target_contact_velocity for part in parts])[order]
        np.testing.assert_allclose(both.target_contact_velocity, target, atol=1e-6 * np.abs(target).max())
        assert both.residual < 1e-9
    assert scaled.count(1) > 4


@pytest.mark.parametrize("seed", [30988, 31044, 32038])
def test_poissons_law(seed: int):
    one, other = _collision(seed, 3.0), _collision(7, 3.0)
    c, order = _both(one, other)
    e, rest = [1.0, 0.5, 0.2][: len(one.labels)], [0.9, 0.4, 0.3][: len(other.labels)]
    parts = [_resolved(Coulomb(Poisson(own)), part) for own, part in ((e, one), (rest, other))]
    assert parts[0].restitution_scale < parts[1].restitution_scale == 1.0
    both = _resolved(Coulomb(Poisson(list(np.array([*e, *rest])[order]))), c)
    assert both.restitution_scale == pytest.approx(parts[0].restitution_scale, abs=1e-6)
    alone = np.concatenate([part.post_velocity for part in parts])
    np.testing.assert_allclose(both.post_velocity, alone, atol=1e-6 * c.pre_speed)
    assert both.residual < 1e-9


@pytest.mark.parametrize("law", [Newton, Poisson])
@pytest.mark.parametrize("joined", [False, True])
def test_many_bodies_with_degrees_of_freedom_of_their_own(law: type, joined: bool):
    """Each body collides as if it were alone; two bodies joined by an equality constraint collide as one."""
    several = [_collision(seed, 0.3) for seed in range(8)]
    c = several[0]
    for other in several[1:]:
        c, _ = _both(c, other)
    tie = np.zeros((1, len(c.pre_velocity)))
    tie[0, [0, -1]] = 1.0, -1.0
    if joined:
        c = replace(c, bilateral_jacobian=tie)
    e = np.linspace(0.1, 0.9, len(c.labels))
    impact = _resolved(Coulomb(law(list(e))), c)
    assert impact.residual < 1e-9
    assert impact.work_after_jump <= 1e-9
    assert abs(tie @ (impact.post_velocity - c.pre_velocity)) < 1e-12 or not joined
    assert len(apart(c, law(list(e)))) == (7 if joined else 8)
    for contacts, part in apart(c, law(list(e))):
        alone = _resolved(Coulomb(law(list(e[contacts]))), part)
        np.testing.assert_allclose(impact.impulse[contacts], alone.impulse, rtol=1e-9)
        assert alone.residual < 1e-9


@pytest.mark.parametrize("law", [Moreau(0.5), Newton([0.5, 0.4])])
def test_contacts_of_which_some_tremble_are_tied_no_more_than_others(law):
    """The outcome of one body with friction and restitution is judged without the other body."""
    c = Collision(np.eye(4), np.eye(4)[[0, 2]], [-1.0, 0.3, -1.0, 0.2])
    assert ties_of(as_closed(law), c) is None


def test_contacts_that_a_law_ties():
    """Contacts are tied if their targets depend on each other: no contacts, those of a matrix, or all if unknown."""
    one, _ = _both(_collision(0, 1.0), _collision(0, 1.0))
    h = len(one.labels)
    for law in (MaximalDissipation(), Moreau(0.5), Newton(np.linspace(0.1, 0.9, h)), Poisson(np.linspace(0.1, 0.9, h))):
        assert ties_of(law, one) is None
    E = 0.5 * np.eye(h)
    E[0, 1] = 0.1
    ties = ties_of(Fremond(E), one)
    assert ties is not None
    np.testing.assert_array_equal(ties, E != 0.0)
