"""Put an impact law into bare environments of dm_control, suite and composer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import gymnasium

from impactlaw.envs.episode_seeds import OUTCOMES, NoSeeds
from impactlaw.envs.law_options import LawOptions
from impactlaw.envs.logs.episode_log import episode_log
from impactlaw.envs.placing.placed_law import PlacedLaw
from impactlaw.errors import WrapperError
from impactlaw.laws import Law

if TYPE_CHECKING:
    import dm_env


def put_law(
    env: dm_env.Environment,
    law: str | Law | Mapping[str, Any],
    restitution: Any = None,
    *,
    contact_model: Literal["rigid", "soft"] = "soft",
    scheme: Literal["event-driven", "time-stepping"] | None = None,
    friction: Literal["coulomb", "convex", "ignore"] | None = None,
    rest_speed: float | None = None,
    on_inadmissible: Literal["raise", "project", "allow"] = "project",
    contacts: str | Sequence[str] | None = None,
    limits: bool = True,
    impulse_in_cfrc_ext: bool = False,
    log: str | Path | None = None,
    log_every: int = 1,
) -> PlacedLaw:
    """Put an impact law into a bare dm_control environment, suite or composer, and return a handle on it.

    ``placed = put_law(suite.load("hopper", "hop"), "moreau", 0.5)``. The environment itself is changed. The handle
    holds the collisions of the last environment step (``events``) and the numbers of `ImpactLaw`'s info (``info()``);
    it can remove the law (``remove()``) and end the recording (``close()``). If the simulation diverges, dm_control
    raises its `PhysicsError`, as without the law. A copy of the environment, or of its physics, has the law too, and
    continues bit for bit as the original, but does not record; `placed_law` returns its handle.

    The arguments and errors are those of `ImpactLaw`. A log also has actions and rewards of steps that are taken
    through this environment, or through a wrapper that steps it.

    Raises:
        WrapperError: the environment is not one of dm_control, or has a law already.
    """
    if isinstance(env, gymnasium.Env) or not hasattr(env, "physics"):
        hint = "use impactlaw.envs.ImpactLaw" if isinstance(env, gymnasium.Env) else "it has no physics"
        raise WrapperError(f"{type(env).__name__} is not an environment of dm_control: {hint}")
    from impactlaw.envs.placing.dm_control import OnDmControl

    options = LawOptions(
        law=law, restitution=restitution, contact_model=contact_model, scheme=scheme, friction=friction,
        rest_speed=rest_speed, on_inadmissible=on_inadmissible, contacts=contacts, limits=limits,
        impulse_in_cfrc_ext=impulse_in_cfrc_ext,
    )  # fmt: skip
    placed = OnDmControl(env, options, episode_log(log, log_every))
    placed.seeds = NoSeeds(OUTCOMES)
    placed.record_steps(env)
    return placed


def placed_law(env: dm_env.Environment) -> PlacedLaw | None:
    """Return the handle on the law of a bare dm_control environment, such as a copy; None if it has no law."""
    from impactlaw.envs.placing.dm_control import law_on

    physics = getattr(env, "physics", None)
    return None if physics is None else law_on(physics)
