"""The studies of friction: no random collision, and none of any scene, creates energy; their quick forms."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))

import random_collisions
import scene_energy


@pytest.fixture(scope="module")
def table():
    return random_collisions.run(random_collisions.RandomCollisions(quick=True))


def test_no_random_collision_creates_energy(table):
    assert len(table) == 300
    assert table.energetic.max() < random_collisions.TOLERANCE
    assert random_collisions.failed(table).empty


def test_every_law_and_cone_is_drawn(table):
    assert set(table.law) == {"MaximalDissipation", "Moreau", "Newton", "Fremond"}
    assert set(table.cone) == {"exact", "convex"}
    assert (table.restitution_scale < 1).sum() > 3
    assert (table.restitution_scale == 1).sum() > 200
    assert (table.contacts < table.rows).all()


def test_what_creates_energy_is_found(table):
    worse = table.copy()
    worse.loc[7, "energetic"] = 2e-9
    worse.loc[9, "error"] = "SolverError: none"
    assert list(random_collisions.failed(worse).k) == [7, 9]
    assert "Moreau" in random_collisions.format_table(worse)


def test_a_collision_is_the_same_whoever_draws_it():
    one, two = (random_collisions.random_collision(np.random.default_rng([0, 5]), 8) for _ in range(2))
    np.testing.assert_array_equal(one.friction.jacobian, two.friction.jacobian)
    np.testing.assert_array_equal(one.pre_velocity, two.pre_velocity)


def test_no_collision_of_any_scene_creates_energy():
    table = scene_energy.run(scene_energy.SceneEnergy(quick=True))
    assert table.collisions.sum() > 20
    assert table.energetic.max() <= scene_energy.TOLERANCE
    assert table.residual.max() < 1e-9
