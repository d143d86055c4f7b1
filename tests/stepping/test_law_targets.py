"""What rules with friction ask of contacts, some of which no normal impulse can move."""

import numpy as np
import pytest

from impactlaw import Collision, Friction, Poisson
from impactlaw.stepping.law_targets import LawTargets

AXES = {"normal": [1.0, 0.0], "along": [0.0, 1.0]}


@pytest.mark.parametrize(
    ("contact", "sliding"),
    [
        ([0, 1], [1.25, 1.25]),  # the first contact gives mu (1 + e) |gamma-| of friction, the other one none
        ([1], [2.0]),  # no contact has friction
    ],
)
def test_sliding_velocities_of_friction_that_no_normal_impulse_causes(contact: list[int], sliding: list[float]):
    gradients = [AXES["normal"], [0.0, 0.0]]
    friction = Friction([AXES["along"]] * len(contact), contact, [0.5] * len(contact))
    collision = Collision(np.eye(2), gradients, [-1.0, 2.0], labels=("ball/floor", "wheel/floor"), friction=friction)
    asked = LawTargets(Poisson(0.5)).with_friction(collision)
    assert asked is not None
    np.testing.assert_allclose(asked[0], [0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(asked[1], sliding, atol=1e-12)
