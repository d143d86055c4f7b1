"""What many worlds are for: how a task begins, steps and judges them."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from gymnasium import spaces

from impactlaw.batch import Batch
from impactlaw.errors import WorldsFailedError


class Outcome(NamedTuple):
    """What follows from steps of worlds.

    Attributes:
        reward: (n,).
        terminated: whether their episodes end, bool (n,).
        diverged: whether the simulation has left the finite numbers, bool (n,): they are where the step began.
        info: what else there is to know, (n, ..) each.
    """

    reward: np.ndarray
    terminated: np.ndarray
    diverged: np.ndarray
    info: dict[str, np.ndarray]


class Task(Protocol):
    """What worlds are for.

    Attributes:
        model: of all worlds.
        keyframe: to which the batch resets a world; -1 for none.
        observation_space: of one world.
        action_space: of one world.
        frame_skip: timesteps of a step.
    """

    model: mujoco.MjModel
    keyframe: int
    observation_space: spaces.Box
    action_space: spaces.Box
    frame_skip: int

    def bind(self, batch: Batch) -> None:
        """Take these worlds."""
        ...

    def start(self, world: int, rng: np.random.Generator) -> None:
        """Let a world, which the batch has reset, begin an episode."""
        ...

    def step(self, worlds: np.ndarray, action: np.ndarray) -> Outcome:
        """Take one step of the environment in some worlds, int (n,), with an action for each, and judge it."""
        ...

    def observe(self) -> np.ndarray:
        """Return observations of all worlds, (nsim, ..)."""
        ...


def step_worlds(batch: Batch, worlds: np.ndarray, nstep: int = 1) -> np.ndarray:
    """Take steps of some worlds, int (n,); return which have left the finite numbers, bool (n,): they are not stepped.

    Raises:
        WorldsFailedError: some have failed in another way.
    """
    try:
        batch.step(None if len(worlds) == batch.nsim else worlds.tolist(), nstep)
    except WorldsFailedError as error:
        if not error.diverged:
            raise
        return np.isin(worlds, error.worlds)
    return np.zeros(len(worlds), bool)
