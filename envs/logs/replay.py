"""Restart an environment at the beginning of a recorded episode."""

from __future__ import annotations

import re
from typing import Any

import gymnasium
import numpy as np

from impactlaw.envs.base import ImpactEnv
from impactlaw.envs.law_holder import law_holder
from impactlaw.envs.logs.how_made import how_made
from impactlaw.envs.placing.placed_law import PlacedLaw
from impactlaw.errors import RecordingError
from impactlaw.recording import Episode
from impactlaw.recording.properties import law_name


def restart(env: gymnasium.Env, episode: Episode, *, allow_law_changes: bool = False) -> tuple[Any, dict[str, Any]]:
    """Reset an environment to the start of a recorded episode, under the law that the episode began with.

    ``for action in episode.actions: env.step(action)`` then passes through the same states, to the last bit. Returns
    observation and info, as `reset` does.

    The environment must have been made like the recorded one. Compared are its name, the options of the law, timestep,
    frame_skip, integrator, the initial state, and in the model: masses, sizes, friction, joints, actuators, tendons,
    gravity, contact parameters, wind, density, viscosity, height fields and disable flags. Others, such as meshes and
    sites, are not. If the model was changed after the reset, as by other masses, the environment must have these before
    `restart`, or get them in its own reset. An episode in which the law, the model or the state was changed later is
    refused, since its actions alone do not reproduce it; so is one that went on after a step with an error.

    Args:
        env: an environment of this package, or one with an `ImpactLaw` around it.
        episode: an episode from ``impactlaw.recording.read_log(path).episode(number)``.
        allow_law_changes: accept an episode in which the law was set. The caller must then set the law to the `value`
            of each of ``episode.law_changes`` before its `step`.

    Raises:
        RecordingError: episode is not an `Episode`; the recording has neither a seed nor a generator state; the
            environment differs from the recorded one; or law, model or state were changed during the episode.
        WrapperError: the environment has no impact law.
    """
    if not isinstance(episode, Episode):
        raise RecordingError(f"an episode is one of read_log(path).episodes, got {type(episode).__name__}")
    if episode.seed is None and episode.generator is None:
        raise RecordingError(
            f"episode {episode.number} was recorded without a seed and without the state of a random generator; "
            "set qpos and qvel of its first frame instead"
        )
    holder = law_holder(env)
    _check_same(env, holder, episode)
    if episode.law_changes and not allow_law_changes:
        first = episode.law_changes[0]
        raise RecordingError(
            f"the law was set during episode {episode.number}: before step {first.step} to {first.law:.200}; pass "
            "allow_law_changes=True, and set the law of the environment to the value of each of episode.law_changes "
            "before its step"
        )
    if episode.model_changes:
        raise RecordingError(
            f"the model was changed during episode {episode.number}, first before step {episode.model_changes[0]}: "
            f"reset(seed={episode.seed}) begins it, but its actions alone do not reproduce it"
        )
    if episode.state_changes:
        raise RecordingError(
            f"the state was changed during episode {episode.number}, first before step {episode.state_changes[0]}, by "
            f"hand or by a step that failed halfway: reset(seed={episode.seed}) begins it, but its actions alone do "
            "not reproduce it"
        )
    if episode.seed is None and episode.generator is not None:
        env.unwrapped.np_random.bit_generator.state = episode.generator
    found = env.reset(seed=episode.seed, options=dict(episode.settings) or None)
    _check_made(holder, episode)
    _check_law(holder, episode)
    _check_start(holder, episode)
    return found


def _check_same(env: gymnasium.Env, holder: PlacedLaw | ImpactEnv, episode: Episode) -> None:
    """Raise if name, scene or contact model differ: a later check would report it less clearly."""
    spec = env.unwrapped.spec
    if episode.qpos.size:
        model = holder.stepper.model
        size, recorded = (model.nq, model.nv), (episode.qpos.shape[1], episode.qvel.shape[1])
        if size != recorded:
            raise _other(episode, f"a scene with (nq, nv) = {recorded}", f"one with {size}")
    if spec is not None and episode.scene in gymnasium.registry and spec.id != episode.scene:
        raise _other(episode, f"{episode.scene}", f"{spec.id}")
    if episode.contact_model not in (None, holder.contact_model):
        raise _other(episode, f"contact_model={episode.contact_model!r}", f"contact_model={holder.contact_model!r}")


def _check_made(holder: PlacedLaw | ImpactEnv, episode: Episode) -> None:
    """Raise if the environment steps differently from the recorded one."""
    mine = how_made(holder.in_force, holder.simulation()[0], holder.frame_skip)
    other = [name for name, value in episode.made.items() if name in mine and value != mine[name]]
    if other:
        recorded, given = (", ".join(f"{name}={made[name]!r}" for name in other) for made in (episode.made, mine))
        raise _other(episode, recorded, f"one with {given}")


def _check_law(holder: PlacedLaw | ImpactEnv, episode: Episode) -> None:
    """Raise if the law differs, for recorded laws that could not be written as reset options."""
    law, recorded = law_name(holder.law) or "", episode.law
    if not episode.settings and recorded is not None:
        # drop the addresses of functions
        mine, theirs = (re.sub(r" at 0x[0-9a-fA-F]+", "", text) for text in (law, recorded))
        if mine != theirs:
            raise _other(episode, f"law {recorded:.200}", f"one with {law:.200}")


def _check_start(holder: PlacedLaw | ImpactEnv, episode: Episode) -> None:
    """Raise if the environment starts in another state than the recorded one."""
    data = holder.simulation()[1]
    for name, mine, recorded in (("qpos", data.qpos, episode.qpos), ("qvel", data.qvel, episode.qvel)):
        if not len(recorded) or np.array_equal(mine, recorded[0], equal_nan=True):
            continue
        i = int(np.flatnonzero(mine != recorded[0])[0])
        why = f"a start with {name}[{i}] = {recorded[0][i]:.9g}"
        raise _other(episode, why, f"one with {mine[i]:.9g}, as by other noise at resets")


def _other(episode: Episode, recorded: str, given: str) -> RecordingError:
    return RecordingError(
        f"episode {episode.number} was recorded in another environment: {recorded}, but this is {given}; "
        "make it as the recorded one was"
    )
