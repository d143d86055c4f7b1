"""Laws of environments, own and wrapped: set later, asked for at a reset, named in info, and written into specs."""

import copy
import math
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from own_envs import every_env
from wrapped import hopper, shimmy_task, theirs

from impactlaw import Coulomb, Fremond, Moreau, Newton
from impactlaw.envs import ImpactLaw
from impactlaw.errors import ImpactLawError, RestitutionError, SceneError, SettledError, UnknownNameError
from impactlaw.laws import MaximalDissipation

pytestmark = theirs

JUGGLER = "impactlaw.envs:impactlaw/Juggler-v0"


def juggler(**options):
    return gymnasium.make(JUGGLER, **options)


def kept(env, steps=2000):
    """The part of their speeds that contacts keep in the next collision, from here on."""
    inner = env if isinstance(env, ImpactLaw) else env.unwrapped
    for _ in range(steps):
        env.step(np.zeros(env.action_space.shape))
        events = inner.events if isinstance(inner, ImpactLaw) else inner.stepper.events
        for event in events:
            impact = event.impact
            hit = impact.impulse > 1e-6
            if hit.any():
                c = impact.collision
                return -impact.post_contact_velocity[hit] / c.pre_contact_velocity[hit]
    raise AssertionError("nothing has collided")


def limp_hopper(**options):
    env = gymnasium.make("Hopper-v5", terminate_when_unhealthy=False)
    return ImpactLaw(env, "moreau", 0.5, **options)


MAKERS = {
    "own": lambda: juggler(frame_skip=1),
    "own, soft": lambda: juggler(contact_model="soft", frame_skip=1),
    "own, time stepping": lambda: juggler(scheme="time-stepping", frame_skip=1),
    "wrapped": limp_hopper,
    "wrapped, rigid": lambda: limp_hopper(contact_model="rigid"),
}
every_maker = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)


# Set later


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


# At a reset


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
    """Somebody's wrapper whose reset takes an option of its own."""

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


# What info says


@pytest.mark.parametrize(
    ("law", "e"),
    [
        (Moreau(0.5), 0.5),
        (Newton({}, default=0.25), 0.25),
        (Newton({"paddle/ball": 0.25}, default=0.5), math.nan),
        (Newton(lambda speed: 0.5), math.nan),
        (Fremond([[0.5]]), math.nan),
        (Fremond.reversal(0.75), 0.75),
        (Coulomb(Moreau(0.5)), 0.5),
        (MaximalDissipation(), 0.0),
    ],
    ids=str,
)
def test_info_names_law_and_restitution(law, e):
    env = juggler(law=law)
    for info in (env.reset(seed=0)[1], env.step(np.zeros(1))[4]):
        assert info["impact/law"] == " ".join(repr(law).split())
        np.testing.assert_equal(info["impact/restitution"], e)


def test_a_law_of_many_numbers_is_named_in_short():
    env = ImpactLaw(gymnasium.make("Ant-v5"), Fremond(np.eye(12)))
    assert env.reset(seed=0)[1]["impact/law"] == "Fremond(...)"


# Specs


ANYWHERE = [("moreau", 0.5), (Moreau(0.5), None), (Newton(0.5), None), (Fremond.reversal(0.5), None)]
LAWS = [
    *((juggler, *law) for law in ANYWHERE),
    (juggler, Newton({("paddle", "ball"): 0.5}, default=0.25), None),
    (juggler, "newton", {("paddle", "ball"): 0.5}),
    (lambda **options: juggler(scheme="time-stepping", **options), Coulomb(Newton(0.5)), None),
    (juggler, Fremond({("ball/paddle", "ball/paddle"): 0.5}), None),
    *((lambda **options: ImpactLaw(gymnasium.make("Hopper-v5"), **options), *law) for law in ANYWHERE),
]


@pytest.mark.parametrize(("make", "law", "restitution"), LAWS, ids=range(len(LAWS)))
def test_a_spec_survives_json(make, law, restitution):
    env = make(law=law, restitution=restitution)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    wanted = repr(env.get_wrapper_attr("law"))
    assert repr(again.get_wrapper_attr("law")) == wanted
    assert repr(gymnasium.make(env.spec).get_wrapper_attr("law")) == wanted
    again.reset(seed=0)


def test_a_spec_with_a_law_that_json_cannot_have_says_so():
    for env in (juggler(law=Newton(lambda speed: 0.5)), ImpactLaw(gymnasium.make("Hopper-v5"), Newton(lambda v: 0.5))):
        with pytest.raises(TypeError, match="not JSON serializable"):
            env.spec.to_json()
        assert gymnasium.make(env.spec).get_wrapper_attr("law") == env.get_wrapper_attr("law")


def test_numbers_of_own_environments():
    for name, value in (("width", 0), ("height", -1), ("width", 2.5), ("frame_skip", math.nan), ("frame_skip", 2.0)):
        with pytest.raises(ImpactLawError, match=name):
            juggler(**{name: value})


@every_env
@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_the_name_with_its_module_works_in_worker_processes(name, context):
    vector = gymnasium.make_vec(
        f"impactlaw.envs:{name}",
        num_envs=1,
        vectorization_mode="async",
        vector_kwargs={"context": context},
        law=Moreau(0.5),
    )
    try:
        _, info = vector.reset(seed=0)
        assert list(info["impact/law"]) == ["Moreau(restitution=0.5)"]
        vector.step(vector.action_space.sample())
    finally:
        vector.close()
