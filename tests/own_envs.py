"""What the tests of environments share."""

import importlib.util
import sys
from pathlib import Path

import gymnasium
import pytest

from impactlaw.envs.base import ImpactEnv

IDS = sorted(
    name for name, spec in gymnasium.registry.items() if name.startswith("impactlaw/") and spec.entry_point is not None
)
INFO = {
    "impact/count": int,
    "impact/energy_change": float,
    "impact/surface_work": float,
    "impact/intensity": float,
    "impact/distant": int,
    "impact/inadmissible": int,
    "impact/diverged": int,
    "impact/law": str,
    "impact/restitution": float,
}
every_env = pytest.mark.parametrize("name", IDS)


def scripts_controllers():
    path = Path(__file__).parents[1] / "scripts" / "controllers.py"
    spec = importlib.util.spec_from_file_location("controllers", path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["controllers"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


controllers = scripts_controllers()


def bare(name, **kwargs) -> ImpactEnv:
    env = gymnasium.make(name, **kwargs).unwrapped
    assert isinstance(env, ImpactEnv)
    return env
