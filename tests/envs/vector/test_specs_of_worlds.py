"""The spec of worlds is plain values, so that the same worlds can be made from its JSON."""

import gymnasium
import numpy as np
import pytest
import scipy.stats
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

from impactlaw import MaximalDissipation, Moreau, Newton
from impactlaw.envs import LawDistribution
from impactlaw.errors import SettledError


@pytest.mark.parametrize("name", ["impactlaw/Juggler-v0", "impactlaw/Hopper-v5"])
@pytest.mark.parametrize(
    "options",
    [
        {"law": Moreau(0.3)},
        {"law": MaximalDissipation()},
        {"law": [Moreau(0.3), Newton(0.6)]},
        {"law": "moreau", "restitution": np.array([0.3, 0.6])},
        {"law": LawDistribution(("moreau", Newton(0.5)), (0.2, 0.9))},
        {"law": LawDistribution(("moreau", "maximal-dissipation"), [0.2, 0.9])},
        {"law": LawDistribution(("moreau",), scipy.stats.beta(2, 5))},
    ],
    ids=["law", "E = 0", "laws", "coefficients", "drawn laws", "drawn from a list", "drawn from beta"],
)
def test_worlds_can_be_made_from_the_json_of_their_spec(name: str, options: dict):
    worlds = gymnasium.make_vec(name, num_envs=2, **options)
    others = worlds
    for _ in range(2):  # also from the spec of worlds that were made so
        others = gymnasium.make_vec(EnvSpec.from_json(others.spec.to_json()), num_envs=2)
    for seed in (0, None, None):
        told, mine = others.reset(seed=seed)[1], worlds.reset(seed=seed)[1]
        assert list(told["impact/law"]) == list(mine["impact/law"])


def test_worlds_tell_when_they_are_reset():
    worlds = gymnasium.make_vec("impactlaw/Juggler-v0", num_envs=2)
    assert worlds.autoreset_mode is AutoresetMode.NEXT_STEP  # as SyncVectorEnv and AsyncVectorEnv do
    with pytest.raises(SettledError, match="autoreset_mode"):
        worlds.autoreset_mode = AutoresetMode.SAME_STEP
