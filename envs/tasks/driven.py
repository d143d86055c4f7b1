"""Environments whose action drives a mocap body, written for one world or for arrays of worlds."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from impactlaw.envs.base import ImpactEnv
from impactlaw.envs.tasks.drive import Drive

Numbers = float | np.ndarray


class Beginning(NamedTuple):
    """The beginning of an episode: positions, (nq,), velocities, (nv,), and the goal of the task, a number."""

    qpos: np.ndarray
    qvel: np.ndarray
    goal: float


class DrivenEnv(ImpactEnv):
    """An environment whose action is the acceleration of a mocap body, as a fraction of its drive's largest one.

    `move`, `see` and `rate` accept one state or arrays of n states, so that the same code serves many worlds.
    """

    DRIVE: ClassVar[Drive]
    DRIVEN: ClassVar[str]
    """Name of the mocap body."""

    @abstractmethod
    def draw(self, rng: np.random.Generator) -> Beginning:
        """Draw the beginning of an episode."""

    @staticmethod
    @abstractmethod
    def move(place: Numbers, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Write the pose of the body for a drive position: position, (3,) or (n, 3), quaternion, (4,) or (n, 4)."""

    @staticmethod
    @abstractmethod
    def see(qpos: np.ndarray, qvel: np.ndarray, place: Numbers, speed: Numbers, goal: Numbers) -> np.ndarray:
        """Return the observation, (k,) or (n, k), from states, (nq,) or (n, nq), drives and goals."""

    @abstractmethod
    def rate(self, qpos: np.ndarray, qvel: np.ndarray, goal: Numbers) -> tuple[Numbers, Numbers]:
        """Return the reward of a state, or of n states, and whether it terminates the episode."""

    @cached_property
    def mocap(self) -> int:
        """Index of the body among the mocap bodies."""
        return int(self.model.body(self.DRIVEN).mocapid[0])

    def start(self) -> None:
        """Draw an episode and set the state to its beginning."""
        self.data.qpos[:], self.data.qvel[:], self._goal = self.draw(self.np_random)

    def act(self, action: np.ndarray) -> None:
        """Set the commanded acceleration of the drive."""
        self._part = float(action[0])

    def drive(self) -> None:
        """Advance the drive by a timestep, and move the body."""
        self.driven = self.DRIVE.advance(*self.driven, self._part, self.model.opt.timestep)
        self.move(self.driven[0], self.data.mocap_pos[self.mocap], self.data.mocap_quat[self.mocap])

    def observe(self) -> np.ndarray:
        """Return the observation."""
        place, speed = self.driven
        return self.see(self.data.qpos, self.data.qvel, place, speed, self._goal)

    def judge(self) -> tuple[float, bool]:
        """Return the reward, and whether the episode terminates."""
        reward, over = self.rate(self.data.qpos, self.data.qvel, self._goal)
        return float(reward), bool(over)
