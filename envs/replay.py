"""Back to the start of an episode that was recorded."""

from __future__ import annotations

from typing import Any

import gymnasium

from impactlaw.envs.wrapper import law_holder
from impactlaw.errors import RecordingError
from impactlaw.recording import Episode


def restart(env: gymnasium.Env, episode: Episode) -> tuple[Any, dict[str, Any]]:
    """Reset an environment to the start of a recorded episode, as `reset` does, under the law that it began with.

    ``for action in episode.actions: env.step(action)`` then leads through the same states again, to the last bit, if
    the environment is made as the recorded one was.

    Args:
        env: the environment, one of this package or with an `ImpactLaw` on it.
        episode: from ``impactlaw.recording.read_log(path).episode(number)``.

    Raises:
        RecordingError: the recording does not say what the episode was drawn from, or is of another environment.
        WrapperError: the environment has no impact law.
    """
    if episode.seed is None and episode.generator is None:
        raise RecordingError(
            f"episode {episode.number} was recorded without a seed and without the state of a random generator; "
            "set qpos and qvel of its first frame instead"
        )
    _check_same(env, episode)
    if episode.seed is None and episode.generator is not None:
        env.unwrapped.np_random.bit_generator.state = episode.generator
    return env.reset(seed=episode.seed, options=dict(episode.settings) or None)


def _check_same(env: gymnasium.Env, episode: Episode) -> None:
    """Refuse an environment in which the episode cannot have been recorded, as far as the recording tells.

    Raises:
        RecordingError: it has another name, scene or contact model.
        WrapperError: it has no impact law.
    """
    holder, spec = law_holder(env), env.unwrapped.spec
    if holder.stepper is not None and episode.qpos.size:
        model = holder.stepper.model
        size, recorded = (model.nq, model.nv), (episode.qpos.shape[1], episode.qvel.shape[1])
        if size != recorded:
            raise _other(episode, f"a scene with (nq, nv) = {recorded}", f"one with {size}")
    if spec is not None and episode.scene in gymnasium.registry and spec.id != episode.scene:
        raise _other(episode, f"{episode.scene}", f"{spec.id}")
    if episode.contact_model not in (None, holder.contact_model):
        raise _other(episode, f"contact_model={episode.contact_model!r}", f"contact_model={holder.contact_model!r}")


def _other(episode: Episode, recorded: str, given: str) -> RecordingError:
    return RecordingError(
        f"episode {episode.number} was recorded in another environment: {recorded}, but this is {given}; "
        "make it as the recorded one was"
    )
