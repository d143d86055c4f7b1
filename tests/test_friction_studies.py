"""The studies of friction: random collisions create no energy, and the solver against Clarabel; their quick forms."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

import friction_solvers
import random_collisions
import scene_energy

from impactlaw.friction_impact import cone_problem
from impactlaw.solvers.cone_solve import solve_cones


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


# --- beside Clarabel -------------------------------------------------------------------------------------------------


def test_the_study_of_solvers():
    table = friction_solvers.run(friction_solvers.FrictionSolvers(quick=True))
    own = table[table.solver.str.startswith("impactlaw")]
    assert len(own) == 4
    assert (own.solved == 1.0).all()
    others = table[~table.solver.str.startswith("impactlaw")]
    assert len(others) == 6
    absent = others[others.note == friction_solvers.ABSENT]
    assert len(absent) in (0, 6)
    assert "impactlaw, warm" in friction_solvers.format_table(table)


def test_without_clarabel_its_rows_say_so(monkeypatch):
    monkeypatch.setattr(friction_solvers, "find_spec", lambda name: None)
    table = friction_solvers.run(friction_solvers.FrictionSolvers(quick=True))
    assert (table.note == friction_solvers.ABSENT).sum() == 6
    assert friction_solvers.ABSENT in friction_solvers.format_table(table)


@pytest.mark.parametrize("seed", range(20))
def test_clarabel_finds_the_same_jump(seed):
    """The velocity of the convex relaxation is unique, and an interior point method finds the same one."""
    pytest.importorskip("clarabel", reason="clarabel, a reference to compare with, is not installed")
    collision = random_collisions.random_collision(np.random.default_rng(seed), 6)
    problem = cone_problem(collision, exact=False)
    other = friction_solvers.clarabel_cones(problem, tolerance=1e-10)
    jump = other.reshape(-1) @ problem.rows
    assert np.linalg.norm(solve_cones(problem).jump - jump) < 1e-3 * problem.scale
    energy = 0.5 * jump @ jump + problem.start.reshape(-1) @ other.reshape(-1)
    own = solve_cones(problem)
    x = problem.scaled(own.impulse).reshape(-1)
    assert 0.5 * own.jump @ own.jump + problem.start.reshape(-1) @ x <= energy + 1e-8 * problem.scale**2


def test_no_collision_of_any_scene_creates_energy():
    table = scene_energy.run(scene_energy.SceneEnergy(quick=True))
    assert table.collisions.sum() > 20
    assert table.energetic.max() <= scene_energy.TOLERANCE
    assert table.residual.max() < 1e-9
