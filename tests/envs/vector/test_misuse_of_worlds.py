"""Worlds with wrong arguments raise errors, and keep their state."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import impactlaw.envs  # noqa: F401  (registers the environments)
from impactlaw import AnyOutcome, Coulomb, Moreau, Newton, make_law
from impactlaw.envs import LawDistribution
from impactlaw.errors import (
    ActionError,
    CopyError,
    OptionError,
    RestitutionError,
    SceneError,
    SettledError,
    UnknownNameError,
    UnsupportedError,
)
from impactlaw.laws import MaximalDissipation, Reversal

NAME = "impactlaw/Juggler-v0"
WORLDS = "vector_entry_point"


@pytest.mark.parametrize("mode", [None, "sync"])
def test_one_robot_of_those_that_are_many_worlds(mode):
    with pytest.raises(OptionError, match=r"make_vec\(.*ImpactLaw\(gymnasium.make\(\"Ant-v5\"\)"):
        if mode is None:
            gymnasium.make("impactlaw/Ant-v5")
        else:
            gymnasium.make_vec("impactlaw/Ant-v5", 2, vectorization_mode=mode)


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


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"law": "moro"}, UnknownNameError),
        ({"law": "any-outcome"}, SceneError),
        ({"restitution": 0.5}, RestitutionError),  # world 0 alone could have it
    ],
    ids=str,
)
def test_a_reset_that_is_refused_leaves_worlds_where_they_are(vec, options, error):
    vec.law = ["newton", Reversal(0.5), "maximal-dissipation"]
    vec.reset(seed=0)
    for _ in range(5):
        vec.step(np.ones((3, 1)))
    state, laws = vec.batch.state.copy(), vec.law
    with pytest.raises(error):
        vec.reset(options=options)
    np.testing.assert_array_equal(vec.batch.state, state)
    assert vec.law == laws


def test_a_law_of_some_world_that_is_refused_leaves_all_laws(vec):
    vec.reset(seed=0)
    for set_laws in (vec.batch.set_law, lambda laws: vec.set_attr("law", laws)):
        with pytest.raises(SceneError, match="looks at all contacts"):
            set_laws([Newton(0.1), Newton(0.2), AnyOutcome()])
        np.testing.assert_array_equal(vec.batch.restitution, 0.8)
        assert vec.law == vec.batch.law == (Newton(0.8),) * 3


def test_what_worlds_do_not_have_is_refused(vec):
    with pytest.raises(UnknownNameError, match="lw"):
        vec.reset(options={"lw": "moreau"})
    with pytest.raises(SettledError, match="settled"):
        vec.set_attr("scheme", "event-driven")
    with pytest.raises(OptionError, match="3 worlds"):
        vec.set_attr("law", [Moreau(0.1)])
    with pytest.raises(RestitutionError):
        vec.set_attr("restitution", [0.1, 0.2, 7.0])
    assert [law.restitution for law in vec.get_attr("law")] == [0.8] * 3


@pytest.mark.parametrize("name", [NAME, "impactlaw/Hopper-v5"])
def test_numbers_of_worlds_that_are_none(name):
    for count in (-1, 0, 1.5):
        with pytest.raises(OptionError, match="num_envs must be a whole number"):
            gymnasium.make_vec(name, count, vectorization_mode=WORLDS)


@pytest.mark.parametrize("name", [NAME, "impactlaw/Hopper-v5"])
def test_laws_that_do_not_fit_the_worlds(name):
    for laws, error, message in (
        (["reversal", "reversal"], OptionError, "3 worlds need as many laws, got 2"),
        ([Moreau(0.5)] * 4, OptionError, "3 worlds need as many laws, got 4"),
        ([], OptionError, "3 worlds need as many laws, got 0"),
        (["moro"] * 3, UnknownNameError, "moro"),
        (LawDistribution(("moreau",), (0.4, 1.0)), RestitutionError, "LawDistribution has its own restitution"),
        (Moreau(0.5), RestitutionError, "already has its restitution"),
    ):
        with pytest.raises(error, match=message):
            gymnasium.make_vec(name, 3, vectorization_mode=WORLDS, law=laws, restitution=0.5)
    for laws in (["reversal", Moreau(0.5), "maximal-dissipation"], ("reversal", Moreau(0.5), "maximal-dissipation")):
        vec = gymnasium.make_vec(name, 3, vectorization_mode=WORLDS, law=laws, nthread=1)
        assert list(vec.reset(seed=0)[1]["impact/restitution"]) == [1.0, 0.5, 0.0]
        vec.close()


@pytest.mark.parametrize("name", [NAME, "impactlaw/Hopper-v5"])
def test_laws_and_restitutions_one_for_each_world(name):
    for law, restitution, wanted in (
        ("newton", [0.4, 0.5, 0.6], [Newton(0.4), Newton(0.5), Newton(0.6)]),
        (
            ["moreau", "newton", "maximal-dissipation"],
            (0.4, 0.5, None),
            [Moreau(0.4), Newton(0.5), MaximalDissipation()],
        ),
        (["moreau", "newton", "moreau"], 0.5, [Moreau(0.5), Newton(0.5), Moreau(0.5)]),
        ("reversal", None, [Reversal(1.0)] * 3),
    ):
        vec = gymnasium.make_vec(name, 3, vectorization_mode=WORLDS, law=law, restitution=restitution, nthread=1)
        assert list(vec.law) == wanted
        vec.close()
    with pytest.raises(OptionError, match="3 worlds need as many values of restitution, got 2: give one for each"):
        gymnasium.make_vec(name, 3, vectorization_mode=WORLDS, law="newton", restitution=[0.4, 0.5])


def test_a_distribution_where_a_law_is_wanted(vec):
    several = LawDistribution(("moreau",), (0.4, 1.0))
    with pytest.raises(OptionError, match="not a law: RandomLaw"):
        vec.law = several
    with pytest.raises(OptionError, match="not a law: RandomLaw"):
        gymnasium.make_vec(NAME, 2, vectorization_mode="sync", law=several)


@pytest.mark.parametrize("name", [NAME, "impactlaw/Hopper-v5"])
def test_options_that_there_are_not(name):
    for options, error, message in (
        ({"batch_options": 5}, OptionError, "batch_options is a mapping of friction, on_inadmissible, rest_speed"),
        ({"batch_options": {"rest_sped": 1.0}}, UnknownNameError, "did you mean 'rest_speed'"),
        ({"max_episode_steps": 1.5}, OptionError, "max_episode_steps must be a whole number"),
    ):
        with pytest.raises(error, match=message):
            gymnasium.make_vec(name, 3, vectorization_mode=WORLDS, **options)


@pytest.mark.parametrize("name", [NAME, "impactlaw/Hopper-v5"])
def test_what_is_settled_when_worlds_are_made(name):
    vec = gymnasium.make_vec(name, 2, vectorization_mode=WORLDS, nthread=1, batch_options={"rest_speed": 0.5})
    for option, value in (
        ("nthread", 1), ("frame_skip", 5 if name == NAME else 4), ("max_episode_steps", 1000), ("rest_speed", 0.5),
        ("scheme", "time-stepping"), ("contact_model", "rigid"), ("friction", "coulomb"), ("log", None),
        ("log_every", 1), ("on_inadmissible", "project"),
    ):  # fmt: skip
        assert vec.get_attr(option) == (value, value)
        with pytest.raises(SettledError, match=f"{option} of VectorWorlds is settled"):
            setattr(vec, option, 3)


@pytest.mark.parametrize("nthread", [-1, 1.5, "2"])
def test_numbers_of_threads_that_are_none(nthread):
    with pytest.raises(OptionError, match="or 0 for one per processor"):
        gymnasium.make_vec(NAME, 2, vectorization_mode=WORLDS, nthread=nthread)


@pytest.mark.parametrize("name", ["Hopper-v5", "Ant-v5"])
def test_options_of_single_environments_that_robots_in_worlds_do_not_have(name):
    for options, message in (
        ({"render_mode": "rgb_array"}, "do not take render_mode='rgb_array': put ImpactLaw"),
        ({"scheme": "event-driven"}, "do not take scheme='event-driven': put ImpactLaw"),
        ({"contact_model": "soft", "log": "run.rrd"}, "do not take log='run.rrd'"),
        ({"contact_model": "soft", "scheme": "time-stepping"}, "scheme means nothing to soft steps"),
        ({"contact_model": "hard"}, "contact_model"),
        ({"friction": "ignore"}, "friction can be given in batch_options; put ImpactLaw"),
        ({"limits": False}, "do not take limits=False"),
    ):
        with pytest.raises((OptionError, UnknownNameError), match=message):
            gymnasium.make_vec(f"impactlaw/{name}", 2, **options)
    said = {"scheme": "time-stepping", "contact_model": "rigid", "render_mode": None}
    gymnasium.make_vec(f"impactlaw/{name}", 2, nthread=1, **said).close()


def test_worlds_cannot_be_copied(vec):
    vec.reset(seed=0)
    for make in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(CopyError, match="make another one"):
            make(vec.batch)
    for make in (copy.deepcopy, pickle.dumps):
        with pytest.raises(CopyError, match="make another one"):
            make(vec)


@pytest.mark.parametrize("e", [True, np.True_, "0.5", [True], {"ball/paddle": "0.5"}], ids=repr)
def test_a_restitution_that_is_no_number(vec, e):
    for make in (lambda: make_law("newton", e), lambda: gymnasium.make(NAME, law="newton", restitution=e)):
        with pytest.raises(RestitutionError, match="must be a number"):
            make()
    with pytest.raises(RestitutionError, match="must be a number"):
        vec.reset(seed=0, options={"law": "newton", "restitution": e})
    for name in ("moreau", "reversal", "compliant", "poisson", "routh"):
        with pytest.raises(RestitutionError, match="number"):
            make_law(name, e)


def test_worlds_are_not_copied(vec):
    with pytest.raises(CopyError, match="cannot be copied"):
        copy.copy(vec)


@pytest.mark.parametrize(
    "law", [Newton(0.3), Newton({("ball", "paddle"): 0.3}, default=0.5), Coulomb(Moreau(0.3))], ids=repr
)
def test_a_restitution_for_a_law_that_has_its_own(vec, law):
    vec.law = law
    with pytest.raises(RestitutionError, match=r"already has its restitution.* such as vec.law = Newton\(0.7\)"):
        vec.restitution = 0.5
    with pytest.raises(RestitutionError, match="already has its restitution"):
        vec.reset(options={"restitution": 0.5})
    assert all(repr(one) == repr(law) for one in vec.law)


def test_what_is_called_in_every_world(vec):
    assert vec.call("law") == vec.get_attr("law") == vec.law
    assert vec.call("frame_skip") == (vec.frame_skip,) * 3
    for name, given in (("reset", {}), ("render", {}), ("close", {}), ("law", {"seed": 1})):
        with pytest.raises(UnsupportedError, match=rf"have a method {name} each: call that of all worlds"):
            vec.call(name, **given)
    with pytest.raises(AttributeError, match="lw"):
        vec.call("lw")


@pytest.mark.parametrize("law", ["newton", LawDistribution(("moreau",), (0.2, 0.9))], ids=["one law", "drawn laws"])
def test_a_reset_that_is_refused_draws_nothing(law):
    """The random generators of the worlds and of their laws are neither reset nor advanced."""
    made = [gymnasium.make_vec(NAME, 2, vectorization_mode=WORLDS, law=law, nthread=1) for _ in range(2)]
    for vec in made:
        vec.reset(seed=0)
    for options in ({"seed": 5, "options": {"law": "moro"}}, {"options": {"law": "moro"}}):
        with pytest.raises(UnknownNameError, match="moro"):
            made[0].reset(**options)
        (one, told), (other, known) = (vec.reset() for vec in made)
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(told["impact/restitution"], known["impact/restitution"])
    for vec in made:
        vec.close()
