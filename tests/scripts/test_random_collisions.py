"""The quick form of the study of random collisions: no collision creates energy."""

import numpy as np
import pytest

from scripts.random_collisions import __main__ as random_collisions
from scripts.random_collisions.newton_poisson import shares


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


@pytest.mark.parametrize("k", [496, 1760])
def test_a_thorough_search_goes_on_from_the_best_point(k):
    """Mass ratios up to 1e6, convex cones, redundant contacts."""
    row = random_collisions.row_of(random_collisions.RandomCollisions(), k)
    assert row["error"] == ""
    assert row["residual"] < 1e-9


def test_newton_leaves_s_where_contacts_open_and_poisson_never():
    mixed = shares(400, closing=False)
    assert 0.4 < mixed.penetrates["Newton"] < 0.6
    assert 0.05 < mixed.gains["Newton"] < 0.15
    assert (mixed.loc["Poisson", ["refused", "penetrates", "gains"]] == 0.0).all()


def test_only_poisson_has_distant_effects_where_all_close():
    closing = shares(400, closing=True)
    assert (closing.loc["Newton", ["refused", "penetrates", "gains", "distant"]] == 0.0).all()
    assert 0.15 < closing.distant["Poisson"] < 0.35
