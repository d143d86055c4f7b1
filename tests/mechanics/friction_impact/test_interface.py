"""Observed outcomes, selected contacts, refused arguments, and violations with friction."""

import numpy as np
import pytest
from mechanics.friction_impact.bodies import sphere
from problems import PROBLEMS

from impactlaw import (
    Collision,
    Coulomb,
    Fremond,
    Friction,
    FrictionImpact,
    Impact,
    Moreau,
    Newton,
)
from impactlaw.errors import InvalidCollisionError, RestitutionError, UnknownNameError
from impactlaw.laws import Law

EXACT = {"rtol": 0, "atol": 1e-12}


def test_observed():
    c = sphere([3.0, 0.0, -2.0, 0, 0, 0], 0.1)
    decided = Coulomb(Moreau(0.5)).resolve(c)
    seen = FrictionImpact.observed(c, decided.post_velocity)
    np.testing.assert_allclose(seen.friction_impulse, decided.friction_impulse, **EXACT)
    assert seen.violations.is_admissible()
    assert Impact.observed(c, decided.post_velocity).violations.kinetic > 0.1  # inadmissible without friction
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
    with pytest.raises(InvalidCollisionError, match="is a Friction, got 3"):
        Collision(np.eye(2), [[1.0, 0.0]], [0.0, 0.0], friction=3)
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
    """A body almost at rest on a belt of 1 m/s: an error within rounding of the belt's speed is no violation."""
    belt = Friction([[1, 0, 0]], [0], [0.5], surface_velocity=[-1.0])
    collision = Collision(np.eye(3), [[0, 1, 0]], [0, -5e-9, 0], friction=belt)
    after = Coulomb(Moreau(0.3)).resolve(collision).post_velocity
    for aside, admissible in ((3e-13, True), (3e-8, False)):
        impact = FrictionImpact.observed(collision, after + np.array([0, 0, aside]))
        assert impact.violations.kinetic == pytest.approx(aside, rel=1e-2)
        assert impact.violations.is_admissible() == admissible
