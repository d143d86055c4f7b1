"""Many worlds of gymnasium's robots in space, Ant and Humanoid, with their observations and rewards."""

from __future__ import annotations

from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces

from impactlaw.batch import Batch
from impactlaw.envs.vector.task import Outcome, step_worlds


class Robot:
    """The task of one of gymnasium's robots, with observations and rewards equal to those of gymnasium's environment.

    Args:
        name: name of gymnasium's environment.
        options: arguments of gymnasium's environment, such as ``ctrl_cost_weight``.
    """

    keyframe = -1
    _batch: Batch

    def __init__(self, name: str, **options: Any):
        env: Any = gymnasium.make(name, **options).unwrapped
        self._env, self.model, self.action_space = env, env.model, env.action_space
        self.frame_skip: int = env.frame_skip
        self.observation_space: spaces.Box = env.observation_space
        self._first = env.init_qpos.copy(), env.init_qvel.copy()
        self._normal = name.startswith(("Ant", "HalfCheetah"))  # their initial velocities are normally distributed
        env.close()

    def bind(self, batch: Batch) -> None:
        """Bind the task to the worlds of a batch."""
        self._batch = batch
        self._qpos, self._qvel, self._ctrl = (batch.bind(name) for name in ("qpos", "qvel", "ctrl"))

    def start(self, world: int, rng: np.random.Generator) -> None:
        """Draw an initial state, with noise about the nominal one."""
        noise, (qpos, qvel), nv = self._env._reset_noise_scale, self._first, self.model.nv
        self._qpos[world] = qpos + rng.uniform(-noise, noise, self.model.nq)
        drawn = noise * rng.standard_normal(nv) if self._normal else rng.uniform(-noise, noise, nv)
        self._qvel[world] = qvel + drawn

    def _advance(self, worlds: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Step worlds; return which of them diverged, bool (n,): their steps are undone.

        Controls that are not finite, or huge, count as divergence; MuJoCo would set them to 0 and continue.
        """
        self._ctrl[worlds] = action
        fine = np.abs(self._ctrl[worlds]).max(axis=1) <= mujoco.mjMAXVAL
        diverged = ~fine
        diverged[fine] = step_worlds(self._batch, worlds[fine], self.frame_skip)
        return diverged


class Spatial(Robot):
    """The task of a robot that moves in space.

    ``cfrc_ext`` holds the contact forces in the last timestep of a step, as in a single environment with rigid time
    stepping.
    """

    def __init__(self, name: str, **options: Any):
        super().__init__(name, **options)
        env, mass = self._env, self.model.body_mass
        self._ant = name.startswith("Ant")
        self._hidden = 2 * int(env._exclude_current_positions_from_observation)
        trunk = np.arange(len(mass)) == self.model.body(env._main_body).id if self._ant else None
        self._share = mass / mass.sum() if trunk is None else trunk.astype(float)

    def bind(self, batch: Batch) -> None:
        """Bind the task to the worlds of a batch."""
        super().bind(batch)
        self._places = batch.bind("xpos" if self._ant else "xipos")
        self._felt, self._force = batch.bind("cfrc_ext"), np.zeros((batch.nsim, self.model.nbody, 6))
        parts = () if self._ant else ("cinert", "cvel", "qfrc_actuator")
        self._parts = [batch.bind(name) for name in parts if getattr(self._env, f"_include_{name}_in_observation")]
        tendons = () if self._ant else ("length", "velocity")
        self._tendons = {f"tendon_{name}": batch.bind(f"ten_{name}") for name in tendons}

    def start(self, world: int, rng: np.random.Generator) -> None:
        """Draw an initial state, with noise about the nominal one."""
        super().start(world, rng)
        self._batch.forward([world])
        self._force[world] = 0.0

    def _positions(self, worlds: np.ndarray) -> np.ndarray:
        """Return the horizontal positions of robots, (n, 2): of Ant's trunk, of Humanoid's center of mass."""
        places, mass = self._places[worlds, :, :2], None if self._ant else self._batch.expanded("body_mass")
        if mass is None:
            return np.einsum("b,nbj->nj", self._share, places)
        mass = mass[worlds]  # masses differ between worlds
        return np.einsum("nb,nbj->nj", mass / mass.sum(axis=1, keepdims=True), places)

    def observe(self) -> np.ndarray:
        """Return the observations of all worlds."""
        n = self._batch.nsim
        seen = [self._qpos[:, self._hidden :], self._qvel]
        for part in self._parts:
            seen.append(part[:, 6:] if part.ndim == 2 else part[:, 1:].reshape(n, -1))
        if self._env._include_cfrc_ext_in_observation:
            seen.append(self._forces(slice(None))[:, 1:].reshape(n, -1))
        return np.concatenate(seen, axis=1)

    def _forces(self, worlds: Any) -> np.ndarray:
        force = self._force[worlds]
        return np.clip(force, *self._env._contact_force_range) if self._ant else force

    def step(self, worlds: np.ndarray, action: np.ndarray) -> Outcome:
        """Take one step of the environment in some worlds."""
        env, before = self._env, self._positions(worlds)
        diverged = self._advance(worlds, action)
        stepped, after = worlds[~diverged], before.copy()
        self._force[stepped], after[~diverged] = self._felt[stepped], self._positions(stepped)
        velocity = (after - before) / env.dt
        healthy = self._is_healthy(worlds)
        forward, alive = env._forward_reward_weight * velocity[:, 0], env._healthy_reward * healthy
        used = action if self._ant else self._ctrl[worlds]
        control = env._ctrl_cost_weight * np.square(used).sum(axis=1)
        contact = env._contact_cost_weight * np.square(self._forces(worlds)).sum(axis=(1, 2))
        if not self._ant:
            contact = np.clip(contact, *env._contact_cost_range)
        qpos = self._qpos[worlds]
        info = {
            "x_position": qpos[:, 0], "y_position": qpos[:, 1],
            "distance_from_origin": np.linalg.norm(qpos[:, :2], axis=1),
            "x_velocity": velocity[:, 0], "y_velocity": velocity[:, 1],
            "reward_forward": forward, "reward_ctrl": -control, "reward_contact": -contact, "reward_survive": alive,
        }  # fmt: skip
        info |= {name: value[worlds] for name, value in self._tendons.items()}
        reward = forward + alive - (control + contact)
        return Outcome(reward, ~healthy & env._terminate_when_unhealthy, diverged, info)

    def _is_healthy(self, worlds: np.ndarray) -> np.ndarray:
        height, (low, high) = self._qpos[worlds, 2], self._env._healthy_z_range
        if not self._ant:
            return (low < height) & (height < high)
        state = np.concatenate([self._qpos[worlds], self._qvel[worlds]], axis=1)
        return np.isfinite(state).all(axis=1) & (low <= height) & (height <= high)
