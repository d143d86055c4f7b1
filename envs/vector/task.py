"""The interface of a task in many worlds: how it starts, steps, observes and rewards them."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from gymnasium import spaces

from impactlaw.batch import Batch
from impactlaw.errors import WorldsFailedError


class Outcome(NamedTuple):
    """The outcome of one environment step in n worlds."""

    reward: np.ndarray  # rewards, (n,)
    terminated: np.ndarray  # whether the episodes terminate, bool (n,)
    diverged: np.ndarray  # whether the simulation diverged, bool (n,); these worlds are in the state before the step
    info: dict[str, np.ndarray]  # further entries of ``info``, (n, ..) each


class Task(Protocol):
    """A task in many worlds."""

    model: mujoco.MjModel  # the model of all worlds
    keyframe: int  # keyframe to which the batch resets a world; -1 for the initial state of the model
    observation_space: spaces.Box  # observation space of one world
    action_space: spaces.Box  # action space of one world
    frame_skip: int  # timesteps per step

    def bind(self, batch: Batch) -> None:
        """Bind the task to the worlds of a batch."""
        ...

    def start(self, world: int, rng: np.random.Generator) -> None:
        """Begin an episode in a world that the batch has reset."""
        ...

    def step(self, worlds: np.ndarray, action: np.ndarray) -> Outcome:
        """Take one environment step in some worlds, int (n,), with one action for each, and return the outcome."""
        ...

    def observe(self) -> np.ndarray:
        """Return the observations of all worlds, (nsim, ..)."""
        ...


def step_worlds(batch: Batch, worlds: np.ndarray, nstep: int = 1) -> np.ndarray:
    """Step some worlds, int (n,); return which of them diverged, bool (n,): their steps are undone.

    Raises:
        WorldsFailedError: some worlds failed for another reason.
    """
    try:
        batch.step(None if len(worlds) == batch.nsim else worlds.tolist(), nstep)
    except WorldsFailedError as error:
        if not error.diverged:
            raise
        return np.isin(worlds, error.worlds)
    return np.zeros(len(worlds), bool)
