"""What the environments of this package share: scene, stepper, pictures, recording and ``info``."""

from __future__ import annotations

import copy
from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Literal

import gymnasium
import mujoco
import numpy as np
from gymnasium.spaces import Box

from impactlaw.envs.info import ImpactTally
from impactlaw.envs.rendering import Pictures, has_display
from impactlaw.errors import ActionError, DivergenceError, RenderError, RestitutionError, SceneError, UnknownNameError
from impactlaw.flow import restore_state, save_state
from impactlaw.laws import Law, make_law
from impactlaw.models import START, scene_path
from impactlaw.recording import Recorder
from impactlaw.scene import scene_law, scene_number
from impactlaw.stepper import Stepper


class ImpactEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A scene under an impact law as a gymnasium environment.

    A subclass names its scene and default law, may `edit` the scene, and says how an episode starts, what an action
    does, what is observed, and what the outcome is worth. Collisions are resolved by the law; an outcome that it would
    put outside of the set of possible velocities is projected onto it and counted in ``info`` (`ImpactTally`).
    Observations beyond their space are clipped to it. If the simulation leaves the finite numbers, the episode is
    truncated where the step began and ``info["impact/diverged"]`` is 1.

    A mocap body that a task `drive`s moves every timestep but the first one of an episode, since its velocity is known
    from the second one on (`impactlaw.surfaces`).

    Args:
        law: name of a law (`impactlaw.make_law`), "scene" for what the MJCF itself carries, or a `Law`; the
            environment's own one if not given.
        restitution: what the law takes; the scene's own coefficient if the law needs one and none is given.
        contact_model: "rigid", or "soft" for MuJoCo's contacts between collisions.
        scheme: of rigid contact: "event-driven", if not given, or "time-stepping"; see `Stepper`.
        frame_skip: timesteps per step; the environment's own number if not given.
        render_mode: "rgb_array", "human" or None.
        log: file to record every timestep to (`impactlaw.recording`), from the first reset on until `close`; one
            environment writes to a file, so vectorised ones need one each.
        width: of pictures, pixels.
        height: of pictures, pixels.

    Attributes:
        driven: place and velocity of the mocap body that the task drives, zero at the start of an episode.

    Raises:
        UnknownNameError: no such law, contact model or render mode, or a law for contacts that the scene cannot have.
        RestitutionError: the restitution does not fit the law.
        SceneError: frame_skip is not a positive whole number.
        RenderError: render_mode="human" without a display.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}  # noqa: RUF012

    SCENE: ClassVar[str]
    LAW: ClassVar[str]
    FRAME_SKIP: ClassVar[int]
    OBSERVATION: ClassVar[tuple[tuple[int, float, float], ...]]
    """Count, lowest and highest value of each group of observed numbers."""
    ACTION: ClassVar[tuple[tuple[int, float, float], ...]]

    def __init__(
        self,
        *,
        law: str | Law | None = None,
        restitution: Any = None,
        contact_model: Literal["rigid", "soft"] = "rigid",
        scheme: Literal["event-driven", "time-stepping"] | None = None,
        frame_skip: int | None = None,
        render_mode: str | None = None,
        log: str | Path | None = None,
        width: int = 640,
        height: int = 480,
    ):
        self.frame_skip = self.FRAME_SKIP if frame_skip is None else frame_skip
        _check(self.frame_skip, render_mode)
        spec = mujoco.MjSpec.from_file(str(scene_path(self.SCENE)))
        self.edit(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.law = choose_law(self.model, self.LAW if law is None else law, restitution)
        self.stepper = Stepper(
            self.model, self.law, contact_model=contact_model, scheme=scheme, on_inadmissible="project"
        )
        self.render_mode = render_mode
        self.observation_space = _box(self.OBSERVATION)
        self.action_space = _box(self.ACTION)
        self.metadata = copy.deepcopy(self.metadata) | {"render_fps": max(1, round(1.0 / self.dt))}
        if not has_display():
            self.metadata["render_modes"].remove("human")
        self.driven = 0.0, 0.0
        self._pictures = Pictures(self.model, self.data, width, height)
        self._log = log
        self._recorder: Recorder | None = None

    # -- what a task is made of ------------------------------------------------------------------------------------

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add to the scene what the task needs: actuators, marks."""

    @abstractmethod
    def start(self) -> None:
        """Draw an episode from ``self.np_random`` and put ``self.data`` to its start, from the scene's own."""

    @abstractmethod
    def act(self, action: np.ndarray) -> None:
        """Make the controls, for all timesteps of a step, from an action within its space."""

    def drive(self) -> None:
        """Move ``self.driven`` on by a timestep, and the mocap body that it stands for to where that leads."""

    def watch(self) -> None:
        """Look at the state after a timestep."""

    @abstractmethod
    def observe(self) -> np.ndarray:
        """Return what is observed of the state."""

    @abstractmethod
    def judge(self) -> tuple[float, bool]:
        """Return the reward of a step, and whether it ends the episode."""

    # -- gymnasium -------------------------------------------------------------------------------------------------

    @property
    def dt(self) -> float:
        """Duration of a step, s."""
        return self.model.opt.timestep * self.frame_skip

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode drawn from the seed; there are no options."""
        super().reset(seed=seed)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(START).id)
        self.driven = 0.0, 0.0
        self.start()
        mujoco.mj_forward(self.model, self.data)
        if self._log is not None and self._recorder is None:
            scene = self.spec.id if self.spec is not None else self.SCENE
            self._recorder = Recorder(self.model, self._log, law=self.law, scene=scene, seed=self.np_random_seed)
        if self._recorder is not None:
            self._recorder.step(self.data)
        if self.render_mode == "human":
            self.render()
        return self._observation(), ImpactTally().info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by `frame_skip` timesteps.

        Raises:
            ActionError: the action has the wrong shape or is not finite.
            ImpactLawError: as by `Stepper.step`, but for `DivergenceError`, which ends the episode.
        """
        self.act(self._within_space(action))
        tally, before, driven = ImpactTally(), save_state(self.model, self.data), self.driven
        try:
            for _ in range(self.frame_skip):
                self._timestep(tally)
        except DivergenceError:
            restore_state(self.model, self.data, before)
            self.driven = driven
            mujoco.mj_forward(self.model, self.data)
            return self._observation(), 0.0, False, True, tally.info(diverged=True)
        reward, terminated = self.judge()
        if self.render_mode == "human":
            self.render()
        return self._observation(), float(reward), bool(terminated), False, tally.info()

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return a picture, uint8 (height, width, 3), or show it in a window, as ``render_mode`` says.

        Raises:
            RenderError: there is nothing to draw with; the message names the missing packages.
        """
        return None if self.render_mode is None else self._pictures.draw(self.render_mode)

    def close(self) -> None:
        """End recording and rendering; a second call does nothing."""
        self._pictures.close()
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = self._log = None

    def __getstate__(self) -> dict[str, Any]:
        """A copy goes on from the same state; it draws by itself and does not record."""
        pictures = Pictures(self.model, self.data, *self._pictures.size)
        return self.__dict__ | {"_pictures": pictures, "_recorder": None, "_log": None}

    # -- inside ----------------------------------------------------------------------------------------------------

    def _timestep(self, tally: ImpactTally) -> None:
        if self.data.time > 0:
            self.drive()
        self.stepper.step(self.data)
        tally.add(self.stepper.events)
        if self._recorder is not None:
            self._recorder.step(self.data, self.stepper.events)
        self.watch()

    def _observation(self) -> np.ndarray:
        space = self.observation_space
        assert isinstance(space, Box)
        return np.clip(np.asarray(self.observe(), dtype=float), space.low, space.high)

    def _within_space(self, action: np.ndarray) -> np.ndarray:
        space = self.action_space
        assert isinstance(space, Box)
        action = np.asarray(action, dtype=float)
        if action.shape != space.shape or not np.isfinite(action).all():
            raise ActionError(f"an action is {space.shape[0]} finite number(s), got {action}")
        return np.clip(action, space.low, space.high)


def choose_law(model: mujoco.MjModel, law: str | Law, restitution: Any = None) -> Law:
    """Return the law that an environment was asked for.

    Args:
        model: the scene.
        law: a `Law`, its name, or "scene" for the restitution that the MJCF carries pair by pair.
        restitution: what the law takes; the scene's default coefficient if the law needs one and none is given.

    Raises:
        UnknownNameError: no such law.
        RestitutionError: the restitution does not fit the law, or is missing in the scene too.
    """
    if law == "scene":
        if restitution is not None:
            raise RestitutionError(f"law 'scene' takes its restitution from the scene, got {restitution!r} too")
        return scene_law(model)
    try:
        return make_law(law, restitution)
    except RestitutionError:
        own = scene_number(model, "restitution")
        if restitution is not None or own is None:
            raise
        return make_law(law, own)


def _check(frame_skip: int, render_mode: str | None) -> None:
    if int(frame_skip) != frame_skip or frame_skip < 1:
        raise SceneError(f"frame_skip is a whole number of timesteps, 1 or more, got {frame_skip!r}")
    if render_mode not in (None, *ImpactEnv.metadata["render_modes"]):
        raise UnknownNameError("render mode", render_mode, ImpactEnv.metadata["render_modes"])
    if render_mode == "human" and not has_display():
        raise RenderError('there is no display for render_mode="human"; use "rgb_array", or log="run.rrd"')


def _box(groups: tuple[tuple[int, float, float], ...]) -> Box:
    low = np.concatenate([np.full(count, low) for count, low, _ in groups])
    high = np.concatenate([np.full(count, high) for count, _, high in groups])
    return Box(low, high, dtype=np.float64)
