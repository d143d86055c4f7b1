"""Worlds reset those whose episode has ended as gymnasium's vectors of single environments do."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import NormalizeObservation

from impactlaw.envs import ImpactLaw, LawDistribution
from impactlaw.errors import SettledError, UnknownNameError

HOPPER = "impactlaw/Hopper-v5"


def alike(mine: Any, others: Any, where: str = "info") -> None:
    """Check that two infos of vectors have the same entries, masks included."""
    if isinstance(others, dict):
        assert isinstance(mine, dict)
        for key in others.keys() & mine.keys():
            alike(mine[key], others[key], f"{where}[{key}]")
    elif others.dtype == object:
        for one, other in zip(mine, others, strict=True):
            assert type(one) is type(other), where
            if one is not None:
                assert one == other if isinstance(one, str) else np.allclose(one, other, atol=1e-6), where
    else:
        np.testing.assert_allclose(mine, others, atol=1e-6, err_msg=where)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_worlds_reset_as_single_environments_in_a_vector_do(mode: AutoresetMode):
    """Episodes end by falls and by their length, at different steps in different worlds."""
    law = {"law": "moreau", "restitution": 0.3}
    worlds = gymnasium.make_vec(HOPPER, num_envs=3, autoreset_mode=mode, max_episode_steps=25, **law)
    single = lambda: ImpactLaw(gymnasium.make("Hopper-v5", max_episode_steps=25), contact_model="rigid", **law)  # noqa: E731
    others = gymnasium.vector.SyncVectorEnv([single] * 3, autoreset_mode=mode)
    rng, ends = np.random.default_rng(3), np.zeros(2, int)
    mine, expected = worlds.reset(seed=7)[0], others.reset(seed=7)[0]
    for _ in range(80):
        np.testing.assert_allclose(mine, expected, atol=1e-6)
        action = rng.uniform(-1.0, 1.0, worlds.action_space.shape).astype(np.float32)
        mine, *told, info = worlds.step(action)
        expected, *others_told, others_info = others.step(action)
        for one, other in zip(told, others_told, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6)
        assert info.keys() >= {"x_velocity", "_x_velocity"} & others_info.keys()
        assert {"final_obs", "final_info", "_final_obs", "_final_info"} & info.keys() == (
            {"final_obs", "final_info", "_final_obs", "_final_info"} & others_info.keys()
        )
        alike({name: info[name] for name in info if "final" in name or "velocity" in name}, others_info)
        ends += [told[1].sum(), told[2].sum()]
    assert (ends > 0).all()


def test_the_end_of_an_episode_has_the_law_that_was_in_force():
    drawn = LawDistribution(("moreau",), (0.0, 1.0))
    worlds = gymnasium.make_vec(HOPPER, num_envs=2, law=drawn, autoreset_mode="SameStep", max_episode_steps=2)
    info, ended = worlds.reset(seed=0)[1], []
    for _ in range(6):
        before, info = info, worlds.step(np.zeros((2, 3), np.float32))[4]
        if "final_info" in info:
            np.testing.assert_array_equal(info["final_info"]["impact/restitution"], before["impact/restitution"])
            ended.append(before["impact/restitution"] != info["impact/restitution"])
    assert np.all(ended)
    assert len(ended) == 3


def test_worlds_that_steps_do_not_reset_are_reset_by_a_mask():
    worlds = gymnasium.make_vec("impactlaw/Juggler-v0", num_envs=2, autoreset_mode="Disabled", max_episode_steps=3)
    assert worlds.metadata["autoreset_mode"] is worlds.autoreset_mode is AutoresetMode.DISABLED
    worlds.reset(seed=0)
    action = np.zeros((2, 1), np.float32)
    over = [worlds.step(action)[3] for _ in range(3)][-1]
    assert over.all()
    with pytest.raises(ResetNeeded, match=r"worlds \[0, 1\].*reset_mask"):
        worlds.step(action)
    worlds.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ResetNeeded, match=r"worlds \[1\]"):
        worlds.step(action)
    worlds.reset(options={"reset_mask": np.array([False, True])})
    assert not worlds.step(action)[3].any()


@pytest.mark.parametrize("name", [HOPPER, "impactlaw/Juggler-v0"])
@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, "SameStep"])
def test_the_mode_is_in_the_spec_and_cannot_be_changed(name: str, mode: AutoresetMode | str):
    worlds = gymnasium.make_vec(name, num_envs=2, autoreset_mode=mode)
    again: Any = gymnasium.make_vec(EnvSpec.from_json(worlds.spec.to_json()), num_envs=2)
    assert again.autoreset_mode is AutoresetMode.SAME_STEP
    with pytest.raises(SettledError, match="autoreset_mode"):
        again.autoreset_mode = AutoresetMode.NEXT_STEP


@pytest.mark.parametrize("wrong", ["same-step", None, 3, np.array(["SameStep", "NextStep"]), ["SameStep"]], ids=str)
def test_an_unknown_mode_is_refused(wrong: Any):
    with pytest.raises(UnknownNameError, match="autoreset_mode"):
        gymnasium.make_vec(HOPPER, num_envs=2, autoreset_mode=wrong)


def test_single_environments_alongside_take_the_mode():
    with pytest.warns(match="single environments"):
        made: Any = gymnasium.make_vec(
            "impactlaw/Juggler-v0", num_envs=2, scheme="event-driven", autoreset_mode=AutoresetMode.SAME_STEP
        )
    assert made.autoreset_mode is AutoresetMode.SAME_STEP


def test_gymnasiums_wrappers_read_the_mode():
    worlds = gymnasium.make_vec(HOPPER, num_envs=2, autoreset_mode="SameStep")
    with pytest.raises((ValueError, AssertionError)):  # which of them depends on gymnasium
        NormalizeObservation(worlds)
