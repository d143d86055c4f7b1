"""A law that is given to reset holds for this episode only, also in copies."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from envs_with_laws import every_maker, juggler, kept, limp_hopper
from wrapped import hopper, shimmy_task, theirs

from impactlaw import Moreau, Newton
from impactlaw.envs import ImpactLaw, RandomLaw
from impactlaw.errors import (
    ImpactLawError,
    PassedOnWarning,
    RestitutionError,
    SceneError,
    UnknownNameError,
    WrapperError,
)
from impactlaw.laws import MaximalDissipation

pytestmark = theirs


@every_maker
def test_a_reset_asks_for_the_law_of_its_episode(make):
    env = make()
    target = env if isinstance(env, ImpactLaw) else env.unwrapped
    _, usual = env.reset(seed=0)
    for options, law in (
        ({"law": "moreau", "restitution": 0.25}, Moreau(0.25)),
        ({"restitution": 0.75}, type(target.law)(0.75)),
        ({"law": Newton(0.5)}, Newton(0.5)),
        ({"law": "maximal-dissipation"}, MaximalDissipation()),
    ):
        _, info = env.reset(seed=0, options=options)
        assert target.law == law
        e = getattr(law, "restitution", 0.0)
        assert (info["impact/law"], info["impact/restitution"]) == (repr(law), e)
        np.testing.assert_allclose(kept(env), e, atol=1e-6)
    _, info = env.reset(seed=0)
    assert (info["impact/law"], info["impact/restitution"]) == (usual["impact/law"], usual["impact/restitution"])


@pytest.mark.parametrize("make", [juggler, lambda: limp_hopper(contact_model="rigid")], ids=["own", "wrapped"])
def test_a_reset_asks_for_scheme_and_friction(make):
    env = make()
    target = env if isinstance(env, ImpactLaw) else env.unwrapped
    plans = []
    for options in (None, {"scheme": "time-stepping"}, {"scheme": "event-driven", "friction": "ignore"}, None):
        env.reset(seed=0, options=options)
        plans.append((target.stepper.plan.scheme, target.stepper.friction))
        env.step(np.zeros(env.action_space.shape))
    usual = "time-stepping" if isinstance(env, ImpactLaw) else "event-driven"
    assert plans == [(usual, None), ("time-stepping", None), ("event-driven", "ignore"), (usual, None)]


def test_an_episode_with_options_is_that_of_an_environment_made_with_them():
    asked, made = juggler(), juggler(law="moreau", restitution=0.5, scheme="time-stepping")
    asked.reset(seed=4)
    for _ in range(100):
        asked.step(np.ones(1))
    a, _ = asked.reset(seed=3, options={"law": "moreau", "restitution": 0.5, "scheme": "time-stepping"})
    b, _ = made.reset(seed=3)
    for _ in range(150):
        np.testing.assert_array_equal(a, b)
        a, b = asked.step(np.ones(1))[0], made.step(np.ones(1))[0]


@every_maker
@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"lwa": "moreau"}, UnknownNameError, "did you mean 'law'"),
        ({"law": "moro"}, UnknownNameError, "moreau"),
        ({"restitution": 1.5}, RestitutionError, r"\[0, 1\]"),
        ({"law": Moreau(0.5), "restitution": 0.5}, RestitutionError, "already has"),
        ({"scheme": "explicit"}, (UnknownNameError, SceneError), "scheme"),
        ({"friction": "none"}, UnknownNameError, "friction"),
    ],
    ids=str,
)
def test_options_of_a_reset_that_do_not_fit(make, options, error, message):
    env = make()
    env.reset(seed=0)
    target = env if isinstance(env, ImpactLaw) else env.unwrapped
    before = target.law
    with pytest.raises(error, match=message):
        env.reset(seed=0, options=options)
    assert target.law is before
    env.step(np.zeros(env.action_space.shape))


def starts(env, options):
    """Return the results of the second and the third reset, with refused resets between them if options are given."""
    env.reset(seed=3)
    found = [env.reset()]
    if options is not None:
        with pytest.raises(ImpactLawError):
            env.reset(options=options)
        with pytest.raises(ImpactLawError):
            env.reset(seed=99, options=options)
    found.append(env.reset())
    return [(observation.tolist(), info["impact/law"]) for observation, info in found]


@pytest.mark.parametrize(
    "options", [{"law": "moro"}, {"restitution": 2.0}, {"law": Newton({("nobody", "floor"): 0.5})}]
)
@pytest.mark.parametrize("make", [juggler, hopper, lambda: ImpactLaw(gymnasium.make("Hopper-v5"), "any-outcome")])
@pytest.mark.parametrize("around", [lambda env: env, RandomLaw])
def test_a_reset_that_is_refused_leaves_all_generators_where_they_were(make, around, options):
    assert starts(around(make()), options) == starts(around(make()), None)


@pytest.mark.parametrize("make", [juggler, hopper])
def test_what_is_no_seed_is_refused_and_changes_nothing(make):
    env = make()
    env.reset(seed=3)
    with pytest.raises((ValueError, gymnasium.error.Error), match=r"zero|0 or more"):
        env.reset(seed=-1, options={"restitution": 0.25})
    assert env.get_wrapper_attr("law") == make().get_wrapper_attr("law")


@pytest.mark.parametrize("make", [juggler, hopper])
def test_outcomes_of_a_law_that_is_set_follow_from_the_seed_of_the_episode(make):
    def laws():
        env = make()
        env.reset(seed=3)
        env.set_wrapper_attr("law", "any-outcome")
        first = env.get_wrapper_attr("law")
        env.step(np.zeros(env.action_space.shape))
        env.set_wrapper_attr("law", "any-outcome")
        second = env.get_wrapper_attr("law")
        env.reset()
        return [first, second, env.get_wrapper_attr("law")]

    one = laws()
    assert one == laws()
    assert len(set(map(repr, one))) == 3
    assert "None" not in repr(one)


def test_a_law_that_a_reset_asks_for_where_it_was_removed_is_refused():
    env = hopper()
    env.remove()
    with pytest.raises(WrapperError, match="was removed"):
        env.reset(options={"law": "moreau", "restitution": 0.5})
    env.reset(seed=0, options={})


def test_scheme_means_nothing_to_soft_contact():
    for env in (hopper(), juggler(contact_model="soft")):
        with pytest.raises(SceneError, match="means nothing to soft steps"):
            env.reset(seed=0, options={"scheme": "time-stepping"})


def test_friction_of_soft_collisions_can_be_left_out_for_an_episode():
    env = hopper()
    env.reset(seed=0, options={"friction": "ignore"})
    assert env.stepper is not None
    assert not env.stepper.plan.friction
    env.reset(seed=0)
    assert env.stepper.plan.friction


def test_an_unknown_option_raises_in_dm_control_too():
    env = ImpactLaw(shimmy_task("hopper", "hop"), "moreau", 0.5)
    with pytest.raises(UnknownNameError, match="option of reset 'goal'"):
        env.reset(seed=0, options={"goal": 3})


class Taking(gymnasium.Wrapper):
    """A wrapper from elsewhere whose reset takes an option of its own."""

    def reset(self, *, seed=None, options=None):
        self.taken = options
        return self.env.reset(seed=seed)


def test_options_of_an_environment_inside_are_handed_on_without_ours():
    inner = Taking(gymnasium.make("Hopper-v5"))
    env = ImpactLaw(inner, "moreau", 0.5)
    env.reset(seed=0, options={"goal": 3, "restitution": 0.25})
    assert inner.taken == {"goal": 3}
    assert env.law == Moreau(0.25)
    env.reset(seed=0, options={"restitution": 0.25})
    assert inner.taken is None


@pytest.mark.parametrize("name", ["restitutoin", "Law", "frction"])
def test_an_option_for_the_environment_inside_that_is_nearly_one_of_the_laws_is_told(name):
    inner = Taking(gymnasium.make("Hopper-v5"))
    with pytest.warns(PassedOnWarning, match=f"'{name}' is passed on to the wrapped environment"):
        ImpactLaw(inner, "moreau", 0.5).reset(seed=0, options={name: 0.3})
    assert inner.taken == {name: 0.3}


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
@every_maker
def test_a_copy_keeps_what_is_in_force_and_what_stands(make, copied):
    env = make()
    target = env if isinstance(env, ImpactLaw) else env.unwrapped
    target.law = Moreau(0.3)
    env.reset(seed=0, options={"restitution": 0.6, "law": "newton"})
    twin = copied(env)
    its = twin if isinstance(twin, ImpactLaw) else twin.unwrapped
    assert its.law == Newton(0.6)
    twin.reset(seed=0)
    assert its.law == Moreau(0.3)
    its.law = Moreau(0.1)
    assert target.law == Newton(0.6)
