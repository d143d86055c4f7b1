"""Environments with a law that is drawn for each episode, and with laws that draw their outcomes."""

import json

import gymnasium
import numpy as np
import pytest
import scipy.stats
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit
from wrapped import hopper

import impactlaw.envs  # noqa: F401  (registers the environments)
from impactlaw import AnyOutcome, Moreau, Newton
from impactlaw.envs import ImpactLaw, LawDistribution, RandomLaw, restart
from impactlaw.errors import OptionError, RestitutionError, SceneError, SettledError, UnknownNameError, WrapperError
from impactlaw.recording import read_log

JUGGLER = "impactlaw.envs:impactlaw/Juggler-v0"


def juggler(**options):
    return gymnasium.make(JUGGLER, **options)


def drawn(env, n, seed=0, **options):
    """Return law and restitution of n episodes, the first one seeded."""
    infos = [env.reset(seed=seed if i == 0 else None, **options)[1] for i in range(n)]
    return [(info["impact/law"], info.get("impact/restitution")) for info in infos]


def es(env, n, seed=0):
    return [e for _, e in drawn(env, n, seed)]


@pytest.mark.parametrize("make", [hopper, juggler], ids=["wrapped", "own"])
def test_each_episode_has_another_restitution_that_its_seed_decides(make):
    env = RandomLaw(make(), restitution=(0.4, 1.0))
    one = es(env, 20, 3)
    assert len(set(one)) == 20
    assert all(0.4 <= e <= 1.0 for e in one)
    assert es(env, 20, 3) == one
    assert es(env, 20, 4) != one


def test_what_is_drawn_is_distributed_as_was_asked():
    env = RandomLaw(juggler(), restitution=(0.2, 0.9))
    assert scipy.stats.kstest(es(env, 300), scipy.stats.uniform(0.2, 0.7).cdf).pvalue > 0.01
    env = RandomLaw(juggler(), restitution=scipy.stats.beta(5, 2))
    assert scipy.stats.kstest(es(env, 300), scipy.stats.beta(5, 2).cdf).pvalue > 0.01
    env = RandomLaw(juggler(), restitution=[0.2, 0.9])  # a list is a choice
    assert set(es(env, 30)) == {0.2, 0.9}


def test_laws_are_drawn_and_those_that_take_no_restitution_get_none():
    laws = ("moreau", "maximal-dissipation", "any-outcome", "reversal", Newton(0.3))
    env = RandomLaw(juggler(), laws=laws, restitution=(0.5, 1.0))
    seen = {}
    for law, e in drawn(env, 200):
        seen.setdefault(law.split("(")[0], []).append(e)
    assert set(seen) == {"Moreau", "MaximalDissipation", "AnyOutcome", "Reversal", "Newton"}
    assert all(20 < len(found) < 65 for found in seen.values())
    assert set(seen["MaximalDissipation"]) == {0.0}
    assert set(seen["Newton"]) == {0.3}
    assert set(seen["AnyOutcome"]) == {None}
    assert len(set(seen["Moreau"])) == len(seen["Moreau"])


def test_laws_of_files_are_drawn(tmp_path):
    file = tmp_path / "law.json"
    file.write_text('{"law class": "impactlaw.laws.moreau:Moreau", "restitution": 0.25}')
    env = RandomLaw(hopper(), laws=(str(file), "maximal-dissipation"), restitution=None)
    assert {e for _, e in drawn(env, 20)} == {0.25, 0.0}
    with pytest.raises(RestitutionError, match="cannot read a law from nosuch"):
        LawDistribution(("nosuch.json",))


def test_the_law_that_is_named_is_in_force():
    env = RandomLaw(hopper(), laws=("moreau", "newton"))
    for _ in range(5):
        info = env.reset()[1]
        law = env.env.stepper.law
        assert info["impact/law"] == repr(law)
        assert law.restitution == info["impact/restitution"]


def test_attributes_tell_what_was_drawn():
    rigid = ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5, contact_model="rigid")
    env = RandomLaw(rigid, laws=("moreau", Newton(0.3), "any-outcome"), friction=("ignore",))
    for _ in range(9):
        info = env.reset()[1]
        assert (repr(env.law), env.restitution) == (info["impact/law"], info.get("impact/restitution"))
        assert env.friction == "ignore"


def test_episodes_start_as_they_do_without_it():
    with_it, without = RandomLaw(hopper()), hopper()
    for seed in (5, None, None):
        np.testing.assert_array_equal(with_it.reset(seed=seed)[0], without.reset(seed=seed)[0])


def test_friction_is_drawn_for_rigid_contact():
    env = RandomLaw(hopper(contact_model="rigid"), friction=["coulomb", "ignore"])
    seen = set()
    for i in range(12):
        env.reset(seed=i)
        seen.add(env.env.stepper.friction)
    assert seen == {"coulomb", "ignore"}


def test_options_of_the_user_come_first():
    env = RandomLaw(juggler(), laws=("moreau", "any-outcome", "poisson"), restitution=(0.4, 1.0))
    free = drawn(env, 6, 1)
    for law, e in drawn(env, 6, 1, options={"restitution": 0.1}):
        assert e == 0.1
        assert not law.startswith("Any")
    for law, e in drawn(env, 6, 1, options={"law": "reversal"}):  # whose restitution is 1 if none is given
        assert law == "Reversal(restitution=1.0)"
        assert e == 1.0
    assert drawn(env, 6, 1, options={}) == free
    env.reset(seed=1, options={"law": "moreau", "restitution": 0.2})  # uses as many random numbers
    assert [env.reset()[1]["impact/law"] for _ in range(5)] == [law for law, _ in free[1:]]
    with pytest.raises(UnknownNameError, match="option of reset"):
        env.reset(options={"lw": "moreau"})
    with pytest.raises(OptionError, match="mapping"):
        env.reset(options=["moreau"])


@pytest.mark.parametrize(
    "restitution",
    [(0.4, 1.0), [0.4, 1.0], scipy.stats.beta(2, 3), scipy.stats.uniform(loc=0.1, scale=0.5)],
    ids=["interval", "choice", "beta", "uniform"],
)
def test_made_again_from_its_spec(restitution):
    env = RandomLaw(hopper(), laws=("moreau", "maximal-dissipation", AnyOutcome(seed=3)), restitution=restitution)
    wanted = drawn(env, 8)
    text = env.spec.to_json()
    json.loads(text)
    for spec in (env.spec, EnvSpec.from_json(text)):
        again = gymnasium.make(spec)
        assert str(drawn(again, 8)) == str(wanted)


def test_an_interval_can_be_written_in_yaml():
    written = drawn(RandomLaw(hopper(), restitution={"uniform": [0.4, 1.0]}), 8)
    assert written == drawn(RandomLaw(hopper(), restitution=(0.4, 1.0)), 8)


def test_in_vector_environments():
    def make():
        return RandomLaw(TimeLimit(hopper(), 5), restitution=(0.0, 1.0))

    vec = gymnasium.vector.AsyncVectorEnv([make] * 2)
    _, info = vec.reset(seed=7)
    first = info["impact/restitution"].tolist()
    later = []
    for _ in range(20):
        info = vec.step(np.zeros(vec.action_space.shape, np.float32))[4]
        later.append(tuple(info["impact/restitution"].tolist()))
    vec.close()
    for i in range(2):
        single = make()
        assert first[i] == single.reset(seed=7 + i)[1]["impact/restitution"]
        assert later[-1][i] != first[i]
    assert len({e for e, _ in later}) >= 3


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: RandomLaw(gymnasium.make("Hopper-v5")), WrapperError, "no impact law"),
        (lambda: RandomLaw(gymnasium.make("CartPole-v1")), WrapperError, "no impact law"),
        (lambda: LawDistribution(restitution={"uniform": [0.1, 0.5, 0.9]}), OptionError, "as plain values"),
        (lambda: LawDistribution(restitution={"uniform": [0.1]}), OptionError, "as plain values"),
        (lambda: LawDistribution(restitution={"uniform": 0.3}), OptionError, "as plain values"),
        (lambda: LawDistribution(restitution={"uniform": ["0.1", "0.9"]}), OptionError, "as plain values"),
        (lambda: LawDistribution(restitution={"low": 0.1, "high": 0.9}), OptionError, "as plain values"),
        (lambda: LawDistribution(restitution={"scipy": "none", "args": [], "kwds": {}}), OptionError, "as plain"),
        (lambda: RandomLaw(juggler(), laws=()), OptionError, "laws is a sequence"),
        (lambda: RandomLaw(juggler(), laws="moreau"), OptionError, "laws is a sequence"),
        (lambda: RandomLaw(juggler(), laws={"moreau", "newton"}), OptionError, "laws is a sequence"),  # has no order
        (lambda: RandomLaw(juggler(), laws=iter(["moreau"])), OptionError, "laws is a sequence"),
        (lambda: RandomLaw(juggler(), restitution={0.4, 0.5}), OptionError, "interval"),
        (lambda: RandomLaw(juggler(), restitution=np.array(0.5)), OptionError, "interval"),
        (lambda: RandomLaw(juggler(), laws=("moro",)), UnknownNameError, "did you mean 'moreau'"),
        (lambda: RandomLaw(juggler(), restitution=(0.4, 1.2)), OptionError, "0 <= low <= high <= 1"),
        (lambda: RandomLaw(juggler(), restitution=(0.9, 0.2)), OptionError, "0 <= low <= high <= 1"),
        (lambda: RandomLaw(juggler(), friction=["none"]), UnknownNameError, "friction option"),
        (
            lambda: ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5, contacts=3),
            OptionError,
            "contacts is a pattern",
        ),
        (lambda: RandomLaw(juggler(), restitution=[0.4, 1.2]), RestitutionError, "1.2"),
        (lambda: RandomLaw(juggler(), restitution=[]), OptionError, "interval"),
        (lambda: RandomLaw(juggler(), restitution=0.5), OptionError, "interval"),
        (lambda: RandomLaw(juggler(), restitution=scipy.stats.norm(0.5, 0.1)), OptionError, "reaches from -inf"),
        (lambda: RandomLaw(juggler(), restitution=scipy.stats.beta), OptionError, "frozen one"),
        (lambda: RandomLaw(juggler(), friction="coulomb"), OptionError, "friction is a sequence"),
        (lambda: RandomLaw(juggler(), friction=5), OptionError, "friction is a sequence"),
    ],
)
def test_what_cannot_be_drawn_is_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_a_law_that_was_removed_is_not_drawn_for():
    inner = hopper()
    env = RandomLaw(inner)
    inner.remove()
    with pytest.raises(WrapperError, match="was removed"):
        env.reset()


# -- laws that draw their outcomes -----------------------------------------------------------------------------------


def bounces(env, seed, steps=40, **options):
    env.reset(seed=seed, **options)
    return [env.step(np.zeros(env.action_space.shape))[0].copy() for _ in range(steps)]


@pytest.mark.parametrize(
    "make",
    [
        lambda: juggler(law="any-outcome"),
        lambda: ImpactLaw(gymnasium.make("Hopper-v5"), "any-outcome"),
        lambda: ImpactLaw(gymnasium.make("Hopper-v5"), "any-outcome", contact_model="rigid"),
    ],
    ids=["own", "soft", "rigid"],
)
def test_outcomes_are_drawn_anew_in_every_episode_and_repeat_with_its_seed(make):
    one, other = make(), make()
    first = bounces(one, 3)
    np.testing.assert_array_equal(bounces(other, 3), first)
    np.testing.assert_array_equal(bounces(other, 3), first)
    assert one.get_wrapper_attr("stepper").law.seed == other.get_wrapper_attr("stepper").law.seed
    seeds = set()
    for _ in range(4):
        other.reset()
        seeds.add(other.get_wrapper_attr("stepper").law.seed)
    assert len(seeds) == 4


@pytest.mark.parametrize("name", ["law", "laws", "restitution", "friction"])
def test_what_is_drawn_cannot_be_set(name):
    env = RandomLaw(ImpactLaw(gymnasium.make("Hopper-v5"), "moreau", 0.5))
    env.reset(seed=0)
    before = env.law
    for where in (env, gymnasium.wrappers.RecordEpisodeStatistics(env)):
        with pytest.raises(SettledError, match="another RandomLaw"):
            where.set_wrapper_attr(name, "maximal-dissipation")
    with pytest.raises(SettledError, match="another RandomLaw"):
        setattr(env, name, "maximal-dissipation")
    assert env.law == before == env.env.law


def test_a_seed_of_its_own_stays():
    env = ImpactLaw(gymnasium.make("Hopper-v5"), AnyOutcome(seed=11))
    env.reset(seed=1)
    assert env.stepper.law == AnyOutcome(seed=11)


def test_a_recorded_episode_can_be_replayed(tmp_path):
    env = juggler(law="any-outcome", log=tmp_path / "run.rrd")
    env.reset(seed=1)
    env.reset()
    seen = [env.step([0.2])[0].copy() for _ in range(60)]
    env.close()
    episode = read_log(tmp_path / "run.rrd").episode(1)
    again = juggler(law="any-outcome")
    restart(again, episode)
    np.testing.assert_array_equal([again.step(action)[0] for action in episode.actions], seen)


# -- many worlds -----------------------------------------------------------------------------------------------------


def worlds(n=3, **options):
    return gymnasium.make_vec("impactlaw/Hopper-v5", num_envs=n, vectorization_mode="vector_entry_point", **options)


def test_each_world_draws_at_its_reset():
    vec = worlds(law=LawDistribution(("moreau", "maximal-dissipation"), (0.3, 0.9)), max_episode_steps=6)
    _, info = vec.reset(seed=4)
    told = [info["impact/restitution"].tolist()]
    assert told[0] == vec.unwrapped.batch.restitution.tolist()
    for i in range(3):  # as a single environment with the same seed
        single = RandomLaw(hopper(), laws=("moreau", "maximal-dissipation"), restitution=(0.3, 0.9))
        assert single.reset(seed=4 + i)[1]["impact/restitution"] == told[0][i]
    for _ in range(13):
        *_, info = vec.step(np.zeros(vec.action_space.shape, np.float32))
        told.append(info["impact/restitution"].tolist())
        assert told[-1] == vec.unwrapped.batch.restitution.tolist()
        assert all(law.startswith(("Moreau", "Maximal")) for law in info["impact/law"])
    assert told[0] == told[6] != told[7] == told[13]
    vec.reset(seed=4)
    assert vec.unwrapped.batch.restitution.tolist() == told[0]


def test_worlds_that_do_not_draw_name_their_law_too():
    vec = worlds(law=Moreau(0.5))
    info = vec.reset(seed=0)[1]
    assert set(info) == {"impact/law", "_impact/law", "impact/restitution", "_impact/restitution"}
    assert (info["impact/restitution"] == 0.5).all()
    assert all(name == info["impact/law"][0] and "0.5" in name for name in info["impact/law"])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"law": LawDistribution(("moreau", "any-outcome"))}, SceneError, "a batch cannot be under this law"),
        ({"law": LawDistribution(friction=["coulomb"])}, OptionError, "friction of many worlds"),
        ({"law": LawDistribution(), "restitution": 0.5}, RestitutionError, "has its own restitution"),
    ],
)
def test_what_worlds_cannot_draw_is_refused(options, error, message):
    with pytest.raises(error, match=message):
        worlds(**options)
