"""Shared parts of tests of environments."""

import gymnasium
import pytest

from impactlaw.envs.base import ImpactEnv

IDS = sorted(name for name in gymnasium.registry if name.startswith("impactlaw/") and name.endswith("-v0"))
INFO = {
    "impact/count": int,
    "impact/energy_change": float,
    "impact/surface_work": float,
    "impact/intensity": float,
    "impact/distant": int,
    "impact/inadmissible": int,
    "impact/short": int,
    "impact/diverged": int,
    "impact/law": str,
    "impact/restitution": float,
}
every_env = pytest.mark.parametrize("name", IDS)


def bare(name, **kwargs) -> ImpactEnv:
    env = gymnasium.make(name, **kwargs).unwrapped
    assert isinstance(env, ImpactEnv)
    return env
