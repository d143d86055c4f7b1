"""Worlds that are told nonsense say so, and stay as they were."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import impactlaw.envs  # noqa: F401
from impactlaw.errors import ActionError, OptionError

NAME = "impactlaw/Juggler-v0"
WORLDS = "vector_entry_point"


@pytest.fixture
def vec():
    made = gymnasium.make_vec(NAME, 3, vectorization_mode=WORLDS, nthread=1)
    yield made
    made.close()


def test_a_step_before_the_first_reset(vec):
    with pytest.raises(ResetNeeded, match=r"begin with reset\(\)"):
        vec.step(np.zeros((3, 1)))


def test_actions_of_the_wrong_shape(vec):
    before = vec.reset(seed=0)[0].copy()
    for shape in ((5, 1), (3, 2), (2, 1), (1, 3), (3,), ()):
        with pytest.raises(ActionError, match=r"shape \(3, 1\)"):
            vec.step(np.full(shape, 0.9))
    for actions in (None, "up", [[1.0], [2.0, 3.0], [4.0]]):
        with pytest.raises(ActionError, match=r"shape \(3, 1\)"):
            vec.step(actions)
    np.testing.assert_array_equal(vec.step([[0], [0], [0]])[0][:, 4], before[:, 4])


@pytest.mark.parametrize("seed", [[0, 1], 1.5, "a", -1, [0, 1, 2.5], [0, -1, 2], [0, 1, 2, 3]], ids=str)
def test_seeds_that_are_none(vec, seed):
    with pytest.raises(OptionError, match="one for each of 3 worlds"):
        vec.reset(seed=seed)


def test_seeds_of_worlds(vec):
    wanted = vec.reset(seed=4)[0].copy()
    for seed in (np.int64(4), [4, 5, 6], np.array([4, 5, 6])):
        np.testing.assert_array_equal(vec.reset(seed=seed)[0], wanted)


def test_masks_and_options_that_are_none(vec):
    for mask in (np.ones(2, bool), np.ones((3, 1), bool), [1, 0, 2], True):
        with pytest.raises(OptionError, match="reset_mask is one bool for each of 3"):
            vec.reset(options={"reset_mask": mask})
    with pytest.raises(OptionError, match="options of a reset are a mapping"):
        vec.reset(options=["law"])


@pytest.mark.parametrize("name", [NAME, "impactlaw/Hopper-v5"])
def test_numbers_of_worlds_that_are_none(name):
    for count in (-1, 0, 1.5):
        with pytest.raises(OptionError, match="num_envs must be a whole number"):
            gymnasium.make_vec(name, count, vectorization_mode=WORLDS)
