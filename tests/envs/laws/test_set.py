"""Laws of our own and of wrapped environments that are set later, and options that are fixed when they are made."""

import copy
import math

import gymnasium
import numpy as np
import pytest
from dm_control import suite
from envs_with_laws import JUGGLER, every_maker, juggler, kept
from wrapped import hopper, theirs

from impactlaw import AnyOutcome, Moreau, Newton, Stepper
from impactlaw.envs import ImpactLaw, placed_law, put_law
from impactlaw.errors import ImpactLawError, RestitutionError, SettledError
from impactlaw.laws import MaximalDissipation

pytestmark = theirs


@every_maker
def test_a_law_that_is_set_is_in_force_from_the_next_step_on(make):
    env = make()
    env.reset(seed=0)
    target = env if isinstance(env, ImpactLaw) else env.unwrapped
    for law, e in ((Moreau(0.25), 0.25), (MaximalDissipation(), 0.0), (Newton(0.75), 0.75)):
        target.law = law
        assert target.law is law
        info = env.step(np.zeros(env.action_space.shape))[4]
        assert (info["impact/law"], info["impact/restitution"]) == (repr(law), e)
        env.reset(seed=1)
        assert target.law is law
        np.testing.assert_allclose(kept(env), e, atol=1e-6)


@every_maker
def test_a_restitution_that_is_set_is_that_of_the_law_by_its_name(make):
    env = make()
    target = env if isinstance(env, ImpactLaw) else env.unwrapped
    kind = type(target.law)
    target.restitution = 0.125
    assert target.law == kind(0.125)
    assert target.restitution == 0.125
    assert env.reset(seed=0)[1]["impact/restitution"] == 0.125
    np.testing.assert_allclose(kept(env), 0.125, atol=1e-6)


@every_maker
def test_what_is_set_and_does_not_fit_is_refused_and_changes_nothing(make):
    env = make()
    env.reset(seed=0)
    target = env if isinstance(env, ImpactLaw) else env.unwrapped
    before = target.law
    for name, value in (
        ("law", "moro"),
        ("law", Newton({("nobody", "floor"): 0.5})),
        ("restitution", 1.5),
        ("restitution", math.nan),
    ):
        with pytest.raises(ImpactLawError):
            setattr(target, name, value)
        assert target.law is before
        assert env.step(np.zeros(env.action_space.shape))[4]["impact/law"] == repr(before)


def test_a_law_is_set_through_other_wrappers():
    for env in (juggler(), gymnasium.wrappers.RecordEpisodeStatistics(hopper())):
        env.reset(seed=0)
        assert env.set_wrapper_attr("law", "maximal-dissipation")
        assert env.get_wrapper_attr("law") == MaximalDissipation()
        assert env.step(np.zeros(env.action_space.shape))[4]["impact/law"] == "MaximalDissipation()"


def test_a_law_by_its_name_has_the_restitution_of_the_scene():
    env = juggler(law="moreau", restitution=0.1)
    env.unwrapped.law = "moreau"
    assert env.unwrapped.law == Moreau(0.8)
    wrapped = hopper()
    with pytest.raises(RestitutionError, match="needs a restitution"):
        wrapped.law = "newton"


@pytest.mark.parametrize(("name", "value"), [("law", "newton"), ("restitution", 0.7)])
def test_the_way_from_a_law_without_restitution_is_named(name, value):
    env = hopper()
    env.law = "maximal-dissipation"
    with pytest.raises(RestitutionError, match=r"such as env.law = Newton\(0.7\)"):
        setattr(env, name, value)
    env.law = Newton(0.7)


def test_a_mapping_that_is_no_law():
    with pytest.raises(RestitutionError, match=r"one that impactlaw.laws.portable has made, got {'name': 'moreau'}"):
        hopper().law = {"name": "moreau"}


def test_what_only_this_episode_can_have_cannot_be_set():
    own = juggler(law="maximal-dissipation")
    for env, inner in (
        (own, own.unwrapped),
        (wrapped := ImpactLaw(gymnasium.make("Hopper-v5"), "maximal-dissipation"), wrapped),
    ):
        env.reset(seed=0, options={"law": "moreau", "restitution": 0.7})
        with pytest.raises(RestitutionError, match="maximal-dissipation"):
            inner.restitution = 0.3
        assert inner.law == Moreau(0.7)
        assert inner.restitution is None
        assert env.reset(seed=0)[1]["impact/restitution"] == 0.0
        env.reset(options={"law": "moreau", "restitution": 0.7})
        inner.law = Newton(0.25)
        assert inner.law == Newton(0.25)
        assert env.reset()[1]["impact/restitution"] == 0.25


@pytest.mark.parametrize(
    "name",
    ["contact_model", "scheme", "friction", "frame_skip", "log", "log_every", "width", "height", "model", "data"],
)
def test_other_arguments_of_own_environments_are_settled(name):
    env = juggler()
    with pytest.raises(SettledError, match=f"{name} of Juggler is settled"):
        setattr(env.unwrapped, name, 3)
    with pytest.raises(SettledError, match=f"{name} of Juggler is settled"):
        env.set_wrapper_attr(name, 3)
    with pytest.raises(AttributeError):
        env.unwrapped.stepper = None


@pytest.mark.parametrize(
    "name", ["contact_model", "scheme", "friction", "rest_speed", "on_inadmissible", "log", "log_every"]
)
def test_other_arguments_of_the_wrapper_are_settled(name):
    env = gymnasium.wrappers.TimeLimit(hopper(), 10)
    with pytest.raises(SettledError, match=f"{name} of ImpactLaw is settled"):
        env.set_wrapper_attr(name, 3)


@pytest.mark.parametrize("owner", [Stepper, ImpactLaw])
def test_the_reference_says_of_what_is_settled_how_to_have_another_one(owner):
    assert owner.friction.__doc__.startswith("As it was when this was made; for another one, ")


def test_a_law_that_was_removed_cannot_be_set():
    env = hopper()
    env.remove()
    for name in ("law", "restitution"):
        with pytest.raises(ImpactLawError, match="was removed"):
            setattr(env, name, 0.5)


def wrapped_hopper():
    return ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5)


@pytest.mark.parametrize("mode", ["sync", "async"])
@pytest.mark.parametrize("what", ["own", "wrapped"])
def test_laws_of_vector_environments_can_be_set(mode, what):
    if what == "own":
        vector = gymnasium.make_vec(JUGGLER, num_envs=2, vectorization_mode=mode)
    else:
        kind = gymnasium.vector.SyncVectorEnv if mode == "sync" else gymnasium.vector.AsyncVectorEnv
        vector = kind([wrapped_hopper] * 2)
    try:
        vector.reset(seed=0)
        for values, wanted in (
            (Moreau(0.25), [0.25, 0.25]),
            ([Newton(0.5), Moreau(1.0)], [0.5, 1.0]),
        ):
            vector.set_attr("law", values)
            info = vector.step(vector.action_space.sample())[4]
            np.testing.assert_array_equal(info["impact/restitution"], wanted)
        assert list(info["impact/law"]) == ["Newton(restitution=0.5, default=None)", "Moreau(restitution=1.0)"]
    finally:
        vector.close()


def test_what_vector_environments_cannot_change_is_refused():
    vector = gymnasium.make_vec(JUGGLER, num_envs=2, vectorization_mode="sync")
    for name in ("contact_model", "scheme", "friction", "frame_skip"):
        with pytest.raises(SettledError, match=name):
            vector.set_attr(name, "soft")
    vector.set_attr("restitution", [0.1, 0.2])
    np.testing.assert_array_equal(vector.reset()[1]["impact/restitution"], [0.1, 0.2])
    vector.close()


def test_a_law_set_in_bare_dm_control_draws_the_same_outcomes_in_every_run():
    env = suite.load("hopper", "hop", task_kwargs={"random": 0})
    placed = put_law(env, "moreau", 0.5)
    placed.law = "any-outcome"
    assert placed.law == AnyOutcome()
    copied = placed_law(copy.deepcopy(env))
    copied.law = Moreau(0.5)
    copied.law = "any-outcome"
    assert copied.law == AnyOutcome()
