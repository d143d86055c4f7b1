"""Vector environments made of single environments take laws in the same forms as many worlds do."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import impactlaw.envs  # noqa: F401  (registers the environments)
from impactlaw import Newton
from impactlaw.envs import LawDistribution
from impactlaw.errors import OptionError, RestitutionError, UncompiledWarning
from impactlaw.laws import Reversal

NAME = "impactlaw/Juggler-v0"


def make(name=NAME, **options):
    with pytest.warns(UncompiledWarning, match="only single environments have friction"):
        return gymnasium.make_vec(name, 2, friction="ignore", **options)


@pytest.mark.parametrize("restitution", [[0.1, 0.9], (0.1, 0.9), np.array([0.1, 0.9])], ids=["list", "tuple", "array"])
def test_a_restitution_for_each(restitution):
    """RockingBlock has two contacts, so that two coefficients could also belong to a single environment."""
    vec = make("impactlaw/RockingBlock-v0", law="newton", restitution=restitution)
    assert [law.restitution for law in vec.law] == [0.1, 0.9]
    vec.close()


def test_a_law_for_each():
    vec = make(law=["reversal", Newton(0.3)])
    assert isinstance(vec.law[0], Reversal)
    assert vec.law[1] == Newton(0.3)
    vec.close()


def test_laws_that_are_set_are_in_force():
    vec = make()
    vec.restitution = 0.3
    assert vec.law == (Newton(0.3), Newton(0.3))
    vec.law = "reversal"
    assert all(isinstance(law, Reversal) for law in vec.law)
    vec.law = [Newton(0.2), Newton(0.4)]
    _, info = vec.reset(seed=0)
    assert info["impact/restitution"].tolist() == [0.2, 0.4]
    with pytest.raises(OptionError, match="2 worlds need as many laws"):
        vec.law = [Newton(0.2)] * 3
    vec.close()


def test_what_is_for_worlds_alone():
    with pytest.raises(OptionError, match="LawDistribution is for compiled worlds"):
        gymnasium.make_vec(NAME, 2, friction="ignore", law=LawDistribution(("moreau",), (0.4, 1.0)))
    with pytest.raises(OptionError, match="2 worlds need as many values of restitution, got 3"):
        gymnasium.make_vec(NAME, 2, friction="ignore", restitution=[0.1, 0.2, 0.3])


def test_a_restitution_goes_with_the_law_in_force():
    """As in a single environment."""
    single = gymnasium.make(NAME, scheme="time-stepping")
    vec = gymnasium.make_vec(NAME, 2)
    for env in (single, vec):
        env.reset(seed=0, options={"law": "moreau", "restitution": 0.3})
    single.unwrapped.restitution = 0.5
    vec.restitution = 0.5
    assert {repr(law) for law in vec.law} == {repr(single.unwrapped.law)} == {"Moreau(restitution=0.5)"}
    for env in (single, vec):
        info = env.reset(seed=0)[1]
        assert np.all(info["impact/law"] == "Newton(restitution=0.5, default=None)")
    drawn = gymnasium.make_vec(NAME, 8, law=LawDistribution(("moreau", "reversal"), (0.4, 1.0)))
    drawn.reset(seed=0)
    kinds = [type(law) for law in drawn.law]
    assert len(set(kinds)) == 2
    drawn.restitution = 0.5
    assert [type(law) for law in drawn.law] == kinds
    assert set(drawn.restitution) == {0.5}


@pytest.mark.parametrize("given", [Newton(0.3), "maximal-dissipation", "scene"], ids=repr)
def test_a_restitution_for_a_law_that_has_its_own_is_refused(given):
    """As in a single environment. Regression: a `Law` object that had been set was replaced silently."""
    single = gymnasium.make(NAME, scheme="time-stepping").unwrapped
    vec = gymnasium.make_vec(NAME, 2)
    for env in (single, vec):
        env.law = given
        before = env.law
        with pytest.raises(RestitutionError, match=r"set a law with its restitution, such as (env|vec)\.law"):
            env.restitution = 0.5
        env.reset(seed=0, options={"law": "moreau", "restitution": 0.2})
        with pytest.raises(RestitutionError, match=r"set a law with its restitution, such as (env|vec)\.law"):
            env.restitution = 0.5
        env.reset(seed=0)
        assert repr(env.law) == repr(before)
