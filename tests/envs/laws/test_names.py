"""Names of laws of environments in info and in specs."""

import math

import gymnasium
import numpy as np
import pytest
from envs_with_laws import juggler
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AsyncVectorEnv
from own_envs import IDS
from wrapped import theirs

from impactlaw import Coulomb, Fremond, Moreau, Newton
from impactlaw.envs import ImpactLaw
from impactlaw.errors import ImpactLawError, UnknownNameError
from impactlaw.laws import MaximalDissipation

pytestmark = theirs


@pytest.mark.parametrize(
    ("law", "e"),
    [
        (Moreau(0.5), 0.5),
        (Newton({}, default=0.25), 0.25),
        (Newton({"paddle/ball": 0.25}, default=0.5), None),
        (Newton(lambda speed: 0.5), None),
        (Fremond([[0.5]]), None),
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
        assert info.get("impact/restitution") == e


@pytest.mark.parametrize("make", [juggler, lambda law: ImpactLaw(gymnasium.make("Hopper-v5"), law)])
@pytest.mark.parametrize("law", [None, "scen"])
def test_the_law_of_the_scene_is_among_those_that_an_error_names(make, law):
    env = make(law="maximal-dissipation")
    for ask in (lambda: make(law=law or "scen"), lambda: env.reset(options={"law": law})):
        with pytest.raises(UnknownNameError, match=r"known: .*scene|did you mean 'scene'"):
            ask()


def test_a_law_of_many_numbers_is_named_in_short():
    env = ImpactLaw(gymnasium.make("Ant-v5"), Fremond(np.eye(12)))
    assert env.reset(seed=0)[1]["impact/law"] == "Fremond(...)"


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
    third = gymnasium.make(EnvSpec.from_json(again.spec.to_json()))  # from a spec whose law was plain already
    assert third.spec.to_json() == again.spec.to_json() == env.spec.to_json()
    assert repr(third.get_wrapper_attr("law")) == wanted


def test_a_spec_with_a_law_that_json_cannot_have_says_so():
    for env in (juggler(law=Newton(lambda speed: 0.5)), ImpactLaw(gymnasium.make("Hopper-v5"), Newton(lambda v: 0.5))):
        with pytest.raises(TypeError, match="not JSON serializable"):
            env.spec.to_json()
        assert gymnasium.make(env.spec).get_wrapper_attr("law") == env.get_wrapper_attr("law")


def test_numbers_of_own_environments():
    for name, value in (("width", 0), ("height", -1), ("width", 2.5), ("frame_skip", math.nan), ("frame_skip", 2.0)):
        with pytest.raises(ImpactLawError, match=name):
            juggler(**{name: value})


@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_the_name_with_its_module_works_in_worker_processes(context):
    def every(names=IDS):
        for name in names:
            env = gymnasium.make(f"impactlaw.envs:{name}", law=Moreau(0.5))
            assert env.reset(seed=0)[1]["impact/law"] == "Moreau(restitution=0.5)"
            env.step(env.action_space.sample())
        return env

    vector = AsyncVectorEnv([every], context=context)
    try:
        _, info = vector.reset(seed=0)
        assert list(info["impact/law"]) == ["Moreau(restitution=0.5)"]
        vector.step(vector.action_space.sample())
    finally:
        vector.close()
