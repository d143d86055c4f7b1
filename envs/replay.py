"""Back to the start of an episode that was recorded."""

from __future__ import annotations

from typing import Any

import gymnasium

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
        RecordingError: the recording does not say what the episode was drawn from.
    """
    if episode.seed is None:
        if episode.generator is None:
            raise RecordingError(
                f"episode {episode.number} was recorded without a seed and without the state of a random generator; "
                "set qpos and qvel of its first frame instead"
            )
        env.unwrapped.np_random.bit_generator.state = episode.generator
    return env.reset(seed=episode.seed, options=dict(episode.settings) or None)
