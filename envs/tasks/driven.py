"""Environments whose action drives a mocap body; what one world does in them, many worlds do at once."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from impactlaw.envs.base import ImpactEnv
from impactlaw.envs.tasks.drive import Drive

Numbers = float | np.ndarray


class Beginning(NamedTuple):
    """How an episode begins: positions, (nq,), velocities, (nv,), and what is wanted in it, as a number."""

    qpos: np.ndarray
    qvel: np.ndarray
    goal: float


class DrivenEnv(ImpactEnv):
    """An environment whose action is the acceleration of a mocap body, as a part of its drive's largest one.

    What an environment says of a state it says of arrays of states too, so that many worlds are the same task: `move`,
    `see` and `rate` take one state, or arrays of n.
    """

    DRIVE: ClassVar[Drive]
    DRIVEN: ClassVar[str]
    """Name of the mocap body."""

    @abstractmethod
    def draw(self, rng: np.random.Generator) -> Beginning:
        """Draw how an episode begins."""

    @staticmethod
    @abstractmethod
    def move(place: Numbers, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Write where the body is, (3,) or (n, 3) and (4,) or (n, 4), when its drive is at a place."""

    @staticmethod
    @abstractmethod
    def see(qpos: np.ndarray, qvel: np.ndarray, place: Numbers, speed: Numbers, goal: Numbers) -> np.ndarray:
        """Return what is observed of states, (nq,) or (n, nq), and of drives, (k,) or (n, k)."""

    @abstractmethod
    def rate(self, qpos: np.ndarray, qvel: np.ndarray, goal: Numbers) -> tuple[Numbers, Numbers]:
        """Return the rewards of states, and whether they end their episodes."""

    @cached_property
    def mocap(self) -> int:
        """Number of the body among the mocap bodies."""
        return int(self.model.body(self.DRIVEN).mocapid[0])

    def start(self) -> None:
        """Begin an episode."""
        self.data.qpos[:], self.data.qvel[:], self._goal = self.draw(self.np_random)

    def act(self, action: np.ndarray) -> None:
        """Tell the drive its acceleration."""
        self._part = float(action[0])

    def drive(self) -> None:
        """Move the body."""
        self.driven = self.DRIVE.advance(*self.driven, self._part, self.model.opt.timestep)
        self.move(self.driven[0], self.data.mocap_pos[self.mocap], self.data.mocap_quat[self.mocap])

    def observe(self) -> np.ndarray:
        """Return what is observed."""
        place, speed = self.driven
        return self.see(self.data.qpos, self.data.qvel, place, speed, self._goal)

    def judge(self) -> tuple[float, bool]:
        """Return the reward, and whether the episode ends."""
        reward, over = self.rate(self.data.qpos, self.data.qvel, self._goal)
        return float(reward), bool(over)
