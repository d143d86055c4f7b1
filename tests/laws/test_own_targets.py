"""Targets of a user's own law: invalid ones are refused, by name, in every way to step."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from impactlaw import Batch, Collision, Coulomb, Fremond, Friction, Law, MaximalDissipation, Moreau, Scattered, Stepper
from impactlaw.errors import InvalidCollisionError, RestitutionError, SceneError
from impactlaw.laws import AnyOutcome, LinearMap, Target
from impactlaw.laws.registry import REGISTERED
from impactlaw.models import load

WAYS = [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}]


@dataclass(frozen=True)
class Wrong(Law):
    """A law that returns a given value."""

    kind: str

    def target(self, collision: Collision) -> Any:
        """Return a value that is not a target for this collision."""
        approach = collision.pre_contact_velocity
        return {
            "an array": -0.5 * approach,
            "not finite": Target(np.nan * approach),
            "too many": Target(np.zeros(len(approach) + 6)),
            "a column": Target(approach[:, None]),
        }[self.kind]


@pytest.mark.parametrize("law", [*REGISTERED, Coulomb, Scattered, LinearMap], ids=lambda law: law.__name__)
@pytest.mark.parametrize("collision", ["a", None])
def test_what_is_no_collision_is_refused(law, collision):
    made = {Coulomb: lambda: Coulomb(Moreau(0.5)), Scattered: lambda: Scattered(Moreau(0.5), 0.1)}
    given = {MaximalDissipation: (), AnyOutcome: (), Fremond: ([[0.5]],), LinearMap: ([[0.5]],)}
    law = made[law]() if law in made else law(*given.get(law, (0.5,)))
    with pytest.raises(InvalidCollisionError, match="this takes a Collision, got"):
        law.resolve(collision)


KINDS = pytest.mark.parametrize(
    ("kind", "message"),
    [("an array", "must return a Target"), ("not finite", "not finite"), ("too many", "shape"), ("a column", "shape")],
)


@KINDS
@pytest.mark.parametrize("balls", [2, 3, 4, 5])
def test_resolve_refuses_it(kind, message, balls):
    J = np.eye(balls - 1, balls, 1) - np.eye(balls - 1, balls)
    collision = Collision(np.eye(balls), J, np.eye(balls)[0])
    with pytest.raises(RestitutionError, match=message):
        Wrong(kind).resolve(collision)


@KINDS
@pytest.mark.parametrize("options", WAYS, ids=str)
@pytest.mark.parametrize("friction", [False, True])
def test_steps_refuse_it(kind, message, options, friction):
    model, data = load("box_drop")
    law = Coulomb(Wrong(kind)) if friction else Wrong(kind)
    stepper = Stepper(model, law, **options)
    with pytest.raises(RestitutionError, match=message):
        for _ in range(600):
            stepper.step(data)


def test_a_right_one_is_as_moreau():
    @dataclass(frozen=True)
    class Own(Law):
        def target(self, collision: Collision) -> Target:
            return Target(-0.5 * collision.pre_contact_velocity)

    collision = Collision(np.eye(3), [[-1, 1, 0], [0, -1, 1]], [1, 0, 0])
    expected = Moreau(0.5).resolve(collision).post_velocity
    np.testing.assert_allclose(Own().resolve(collision).post_velocity, expected, atol=1e-14)


@dataclass(frozen=True)
class InPlace(Law):
    def target(self, collision):
        gamma = collision.pre_contact_velocity
        gamma *= -0.5
        return Target(gamma)


def test_a_law_cannot_change_the_velocities_it_is_asked_about():
    """Otherwise the audit would use the changed velocities: no impulse, and no violation."""
    wall = Collision([[1.0]], [[1.0]], [-1.0], friction=Friction(np.zeros((1, 1)), [0], [0.5]))
    with pytest.raises(ValueError, match="read-only"):
        InPlace().resolve(wall)
    assert wall.pre_contact_velocity == [-1.0]
    assert not wall.pre_sliding_velocity.flags.writeable


@dataclass(frozen=True)
class Root(Law):
    """Contacts leave with 0.3 times the square root of their closing speed."""

    per_contact = True

    def target(self, collision):
        return Target(0.3 * np.sqrt(np.abs(collision.pre_contact_velocity)))


@pytest.mark.parametrize("options", WAYS, ids=str)
def test_a_target_that_is_no_multiple_of_the_velocity_is_met_in_every_way_to_step(options):
    """Compiled code only knows multiples of the velocity."""
    model, data = load("bouncing_ball")
    stepper = Stepper(model, Root(), **options)
    while not stepper.events:
        stepper.step(data)
    impact = stepper.events[0].impact
    wanted = 0.3 * np.sqrt(-impact.collision.pre_contact_velocity)
    np.testing.assert_allclose(impact.post_contact_velocity, wanted, rtol=1e-9)
    gravity = 9.81 * model.opt.timestep  # acts during the rest of the step
    np.testing.assert_allclose(data.qvel, wanted, rtol=0, atol=gravity)


def test_a_batch_refuses_a_target_that_is_no_multiple_of_the_velocity():
    model, _ = load("bouncing_ball")
    with pytest.raises(SceneError, match="another part of the velocity at another speed"):
        Batch(model, Root(), 2)
