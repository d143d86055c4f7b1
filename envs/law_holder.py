"""Find the law of an environment among the wrappers around it."""

from __future__ import annotations

import gymnasium

from impactlaw.envs.base import ImpactEnv
from impactlaw.envs.placing.placed_law import PlacedLaw
from impactlaw.envs.wrapper import ImpactLaw
from impactlaw.errors import WrapperError


def law_holder(env: gymnasium.Env) -> PlacedLaw | ImpactEnv:
    """Return the law in the outermost `ImpactLaw` around an environment, or the environment if it is an `ImpactEnv`.

    Raises:
        WrapperError: the environment has no impact law, or the law was removed.
    """
    while isinstance(env, gymnasium.Wrapper):
        if isinstance(env, ImpactLaw):
            if env.law is None:
                raise WrapperError("the law was removed from the ImpactLaw inside: put another one on the environment")
            return env.placed
        env = env.env
    if not isinstance(env, ImpactEnv):
        raise WrapperError(
            f'{type(env).__name__} has no impact law; put one on it first: ImpactLaw(env, "moreau", 0.5)'
        )
    return env
