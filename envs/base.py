"""The base class of this package's environments: scene, stepper, pictures, recording and ``info``."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import gymnasium
import mujoco
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random

from impactlaw.envs.arguments import box, check_arguments
from impactlaw.envs.episode_seeds import OUTCOMES, EpisodeSeeds
from impactlaw.envs.info import impact_info, steps_short
from impactlaw.envs.law_in_force import LawInForce
from impactlaw.envs.law_options import LawOptions, PortableSpec, check_reset
from impactlaw.envs.logs.episode_log import episode_log
from impactlaw.envs.rendering import Pictures, has_display
from impactlaw.errors import ActionError, DivergenceError
from impactlaw.laws import Law
from impactlaw.models import START, scene_path
from impactlaw.settled import Settled
from impactlaw.stepping.compatibility import check_count
from impactlaw.stepping.impact_event import NOTHING, ImpactSums
from impactlaw.stepping.integration import restore_state, save_state

_ANEW = "make a new environment"
_RESET = "pass it to reset(options=...), for an episode, or make a new environment"


class ImpactEnv(PortableSpec, LawInForce, gymnasium.Env[np.ndarray, np.ndarray]):  # pyright: ignore[reportIncompatibleVariableOverride]  (spec)
    """A scene under an impact law as a gymnasium environment.

    A subclass names its scene and default law, may `edit` the scene, and defines how an episode starts, what an action
    does, what is observed and what is rewarded. The law resolves collisions. If its outcome lies outside the set of
    possible velocities, it is projected onto the set and counted in ``info`` (`impact_info`). Observations are clipped
    to their space. If the simulation diverges (a state that is not finite), the state returns to the start of the step,
    the episode is truncated, and ``info["impact/diverged"]`` is 1.

    A mocap body that a task `drive`s moves in every timestep except the first of an episode, because its velocity is
    only known from the second timestep on (`impactlaw.scene.moving_surfaces`).

    Args:
        law: name of a law (`impactlaw.make_law`), "scene" for the restitution that the MJCF itself carries, or a `Law`;
            the environment's default law if not given.
        restitution: argument of the law; the scene's own coefficient if the law needs one and none is given.
        contact_model: "rigid", or "soft" for MuJoCo's contacts between collisions.
        scheme: scheme of rigid contact: "event-driven", the default, or "time-stepping"; see `Stepper`.
        friction: "coulomb", the default, "convex" or "ignore"; see `Stepper`.
        frame_skip: timesteps per step; the environment's default if not given.
        render_mode: "rgb_array", "human" or None.
        log: file in which to record every timestep (`impactlaw.recording`), from the first reset until `close`, such as
            ``run.rrd``, or ``run-{env}-{episode}.rrd``; see `EpisodeLog`.
        log_every: record every log_every-th episode, starting with the first.
        width: width of pictures, pixels.
        height: height of pictures, pixels.

    ``reset(options=...)`` takes "law", "restitution", "friction" and "scheme" for one episode; the next reset without
    them returns to those of the environment. ``info`` names the law and the restitution in force. A law or restitution
    assigned to the environment (``env.unwrapped.law = ...``, ``vec.set_attr("law", ...)``) takes effect with the next
    step and is permanent. All other arguments are fixed at construction, and assigning to them is an error.

    Attributes:
        driven: position and velocity of the mocap body that the task drives, zero at the start of an episode.

    Raises:
        UnknownNameError: there is no such law, contact model or render mode, or the law is keyed by contacts that the
            scene cannot have.
        RestitutionError: the restitution does not fit the law.
        SceneError: frame_skip is not a positive integer, or an option has no meaning for the contact model.
        OptionError: width, height or log_every is not a positive integer, or log has unknown fields.
        RecordingError: the recording exists already.
        RenderError: render_mode="human" without a display.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}  # noqa: RUF012  (as gymnasium declares it)

    _begun = False

    SCENE: ClassVar[str]
    LAW: ClassVar[str]
    FRAME_SKIP: ClassVar[int]
    OBSERVATION: ClassVar[tuple[tuple[int, float, float], ...]]
    """Length, lower bound and upper bound of each group of observed numbers."""
    ACTION: ClassVar[tuple[tuple[int, float, float], ...]]

    model, data, frame_skip = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)
    contact_model, scheme, friction = Settled(_ANEW), Settled(_RESET), Settled(_RESET)
    log, log_every, width, height = Settled(_ANEW), Settled(_ANEW), Settled(_ANEW), Settled(_ANEW)

    def __init__(
        self,
        *,
        law: str | Law | Mapping[str, Any] | None = None,
        restitution: Any = None,
        contact_model: Literal["rigid", "soft"] = "rigid",
        scheme: Literal["event-driven", "time-stepping"] | None = None,
        friction: Literal["coulomb", "convex", "ignore"] | None = None,
        frame_skip: int | None = None,
        render_mode: str | None = None,
        log: str | Path | None = None,
        log_every: int = 1,
        width: int = 640,
        height: int = 480,
    ):
        self.frame_skip = self.FRAME_SKIP if frame_skip is None else frame_skip
        check_arguments(self.frame_skip, render_mode, self.metadata["render_modes"])
        check_count("width", width)
        check_count("height", height)
        self.contact_model, self.scheme, self.friction = contact_model, scheme, friction
        self.log, self.log_every, self.width, self.height = log, log_every, width, height
        self._log = episode_log(log, log_every)
        spec = mujoco.MjSpec.from_file(str(scene_path(self.SCENE)))
        self.edit(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._options = self._in_force = LawOptions(
            law=self.LAW if law is None else law, restitution=restitution, contact_model=contact_model, scheme=scheme,
            friction=friction, usual_scheme="event-driven", overlap=None,
        )  # fmt: skip
        self.seeds = EpisodeSeeds(OUTCOMES)
        self._stepper = self._options.stepper(self.model)
        self.render_mode = render_mode
        self.observation_space = box(self.OBSERVATION)
        self.action_space = box(self.ACTION)
        self.metadata = copy.deepcopy(self.metadata) | {"render_fps": max(1, round(1.0 / self.dt))}
        if not has_display():
            self.metadata["render_modes"].remove("human")
        self.driven = 0.0, 0.0
        self._pictures = Pictures(self.model, self.data, width, height)

    # -- methods that a task defines -------------------------------------------------------------------------------

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Add to the scene what the task needs, such as actuators and marks."""

    @abstractmethod
    def start(self) -> None:
        """Draw an episode from ``self.np_random``, and set ``self.data``, reset to the keyframe, to its start."""

    @abstractmethod
    def act(self, action: np.ndarray) -> None:
        """Set the controls for all timesteps of a step from an action within its space."""

    def drive(self) -> None:
        """Advance ``self.driven`` by a timestep, and move its mocap body to the new position."""

    def watch(self) -> None:
        """Inspect the state after a timestep."""

    @abstractmethod
    def observe(self) -> np.ndarray:
        """Return the observation of the state."""

    @abstractmethod
    def judge(self) -> tuple[float, bool]:
        """Return the reward of a step, and whether the step terminates the episode."""

    # -- gymnasium -------------------------------------------------------------------------------------------------

    @property
    def dt(self) -> float:
        """Duration of a step, s."""
        return self.model.opt.timestep * self.frame_skip

    def simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return model and data."""
        return self.model, self.data

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode drawn from the seed, under the law given in the options.

        Args:
            seed: seed of the random generator.
            options: "law", "restitution", "friction" and "scheme" for this episode only, each as in the constructor; a
                law given without a restitution takes the scene's own.

        Raises:
            UnknownNameError: there is no such option, law or scheme.
            RestitutionError: the restitution does not fit the law.
            SceneError: an option has no meaning for the contact model.
        """
        check_reset(options)
        if seed is not None:
            np_random(seed)  # raises on an invalid seed
        with self.seeds.begun(seed):
            self.use(self._options.for_reset(options, self.seeds))
        super().reset(seed=seed)  # after all checks, so that a refused reset leaves the generators unchanged
        generator = self.np_random.bit_generator.state
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(START).id)
        self.driven = 0.0, 0.0
        self.start()
        self._begun = True
        mujoco.mj_forward(self.model, self.data)
        if self._log is not None:
            name = self.SCENE if self.spec is None else self.spec.id
            self._log.name_run(name, self.np_random_seed, self.frame_skip)
            self._log.begin(self.stepper, self.data, self._in_force, seed=seed, generator=generator)
        if self.render_mode == "human":
            self.render()
        return self._observation(), impact_info(NOTHING) | self._law_info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by `frame_skip` timesteps.

        Raises:
            ResetNeeded: there was no reset yet (gymnasium's own error).
            ActionError: the action has the wrong shape or is not finite.
            ImpactLawError: as raised by `Stepper.step`, except `DivergenceError`, which ends the episode.
        """
        if not self._begun:
            raise ResetNeeded("an episode begins with reset(); call it before step()")
        within = self._within_space(action)
        if self._log is not None:
            self._log.begin_step(self.model, self.data)
        self.act(within)
        sums, before, driven = NOTHING, save_state(self.model, self.data), self.driven
        short = steps_short(self.stepper)
        try:
            for _ in range(self.frame_skip):
                more = self._timestep()
                if more.collisions:
                    sums = sums.with_more(more)
        except DivergenceError:
            restore_state(self.model, self.data, before)
            self.driven = driven
            mujoco.mj_forward(self.model, self.data)
            sums, short = NOTHING, steps_short(self.stepper)  # the timesteps before are undone
            reward, terminated, diverged = 0.0, False, True
        else:
            reward, terminated = self.judge()
            diverged = False
        if self._log is not None:
            self._log.end_step(self.model, self.data, action, reward, bool(terminated), diverged)
        if self.render_mode == "human" and not diverged:
            self.render()
        info = impact_info(sums, short=steps_short(self.stepper) - short, diverged=diverged) | self._law_info()
        return self._observation(), float(reward), bool(terminated), diverged, info

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return a picture, uint8 (height, width, 3), or show it in a window, depending on ``render_mode``.

        Raises:
            RenderError: no OpenGL library works; the message names the missing packages.
        """
        return None if self.render_mode is None else self._pictures.draw(self.render_mode)

    def close(self) -> None:
        """End recording and rendering; a second call has no effect."""
        self._pictures.close()
        if self._log is not None:
            self._log.finish()
            self._log = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, which continues from the same state, has its own renderer and does not record."""
        pictures = Pictures(self.model, self.data, *self._pictures.size)
        return self.__dict__ | {"_pictures": pictures, "_log": None}

    # -- internal --------------------------------------------------------------------------------------------------

    def _timestep(self) -> ImpactSums:
        data, stepper = self.data, self.stepper
        if data.time > 0:
            self.drive()
        stepper.step(data)
        if self._log is not None:
            self._log.step(stepper, data, stepper.events)
        self.watch()
        return stepper.sums

    def _observation(self) -> np.ndarray:
        space = self.observation_space
        assert isinstance(space, Box)
        return np.clip(np.asarray(self.observe(), dtype=float), space.low, space.high)

    def _within_space(self, action: np.ndarray) -> np.ndarray:
        space = self.action_space
        assert isinstance(space, Box)
        try:
            action = np.asarray(action, dtype=float)
        except (TypeError, ValueError):
            raise ActionError(f"an action is {space.shape[0]} finite number(s), got {action!r}") from None
        if action.shape != space.shape or not np.isfinite(action).all():
            raise ActionError(f"an action is {space.shape[0]} finite number(s), got {action}")
        return np.clip(action, space.low, space.high)
