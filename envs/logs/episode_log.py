"""Record the episodes of an environment: which ones, and in which files."""

from __future__ import annotations

import os
import string
from itertools import count
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from impactlaw.envs.law_options import LawOptions, as_plain
from impactlaw.envs.logs.how_made import how_made
from impactlaw.errors import OptionError, RecordingError
from impactlaw.recording import Recorder
from impactlaw.stepping.compatibility import check_count
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.stepper import Stepper

_FIELDS = {"env", "episode"}
_STATE = mujoco.mjtState.mjSTATE_PHYSICS | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT


class EpisodeLog:
    """A recorder of every n-th episode of an environment, which never overwrites a file.

    ``run.rrd`` holds all recorded episodes. The path may have the fields ``{env}`` and ``{episode}``, such as
    ``run-{env}-{episode}.rrd``. With ``{episode}``, the number of the episode, each episode has its own file. ``{env}``
    is the number of the environment: the first one, counted from 0, whose file does not exist yet. Thus each of several
    environments, and each later run, has its own files. A file is created when its first episode begins. If the
    environment compiles another model later, recording continues in ``run-2.rrd``.

    Args:
        path: path of the file, with or without these fields.
        every: record the episodes 0, ``every``, 2 ``every`` and so on.

    Attributes:
        path: as given.
        every: as given.

    Raises:
        OptionError: path is not a path, or has other fields.
        RecordingError: the folder does not exist; or the path has no fields, and the file exists.
    """

    def __init__(self, path: str | Path, *, every: int = 1):
        if not isinstance(path, str | os.PathLike):
            raise OptionError(f'log is the path of a file, such as "run.rrd", got {path!r}')
        self.path, self.every = path, every
        self._path, self._fields = str(path), _fields(str(path))
        self.name_run(None, None, None)
        self._env: int | None = None
        self._episode, self._models, self._last = -1, 1, Path()
        self._on, self._told, self._time = False, False, np.inf
        self._model: mujoco.MjModel | None = None
        self._law: Any = None
        self._made: dict[str, Any] = {}
        self._options: LawOptions | None = None
        self._between = False  # whether no timestep was recorded since a reset or an environment step
        self._seen, self._moved = np.zeros(0), False  # the state then; whether it was changed before the present step
        self._recorder: Recorder | None = None
        first = self._named(0)
        if not first.parent.is_dir():
            raise RecordingError(f"cannot write the recording {first}: there is no folder {first.parent}")
        if first.is_dir():
            raise RecordingError(f"{first} is a folder: log is the path of a file, such as {first / 'run.rrd'}")
        if not self._fields and first.exists():
            raise self._exists(first)

    def pause(self) -> None:
        """Stop recording until the next episode begins, during a reset."""
        self._on, self._told = False, True

    def name_run(self, scene: str | None, seed: int | None, timesteps: int | None) -> None:
        """Set the metadata of files opened from now on: environment, seed, and timesteps per environment step."""
        self._scene, self._seed, self._timesteps = scene, seed, timesteps

    def begin(
        self,
        stepper: Stepper,
        data: mujoco.MjData,
        options: LawOptions,
        *,
        seed: int | None = None,
        generator: Any = None,
    ) -> None:
        """Begin an episode, and record its initial state.

        Args:
            stepper: the stepper of the episode.
            data: the initial state.
            options: the options from which the stepper was made.
            seed: seed of the reset.
            generator: state of the random generator from which the episode was drawn.
        """
        self._episode += 1
        self._on = self._episode % self.every == 0
        if "episode" in self._fields:
            self.finish()
        if not self._on:
            return
        recorder = self._open(stepper)
        self._law = recorder.law = stepper.law
        settings, self._made = options.settings(stepper.law), how_made(options, stepper.model, self._timesteps)
        self._options, self._between, self._seen, self._moved = options, True, _state(stepper.model, data), False
        recorder.begin_episode(self._episode, seed=seed, generator=generator, settings=settings, made=self._made)
        recorder.step(data)

    def watch(self, stepper: Stepper, data: mujoco.MjData, options: LawOptions) -> None:
        """Before a timestep, begin an episode if it is the first one or time went backwards.

        Resets that `pause` reports begin episodes by themselves.
        """
        if not self._told and (data.time < self._time or not np.isfinite(self._time)):
            self.begin(stepper, data, options)

    def step(self, stepper: Stepper, data: mujoco.MjData, events: tuple[ImpactEvent, ...]) -> None:
        """Record a timestep."""
        self._time = data.time
        if not self._on:
            return
        recorder = self._open(stepper)
        if stepper.law is not self._law:
            before, after = as_plain(self._law), as_plain(stepper.law)
            self._law = stepper.law
            if after is None or after != before:  # else it is an equal law, made again
                recorder.change_law(stepper.law, after)
        if self._between and self._options is not None:
            made = how_made(self._options, stepper.model, self._timesteps)
            if made != self._made:
                recorder.change_model(made)
            self._made, self._between = made, False
        if self._moved:
            recorder.change_state()
            self._moved = False
        recorder.step(data, events)

    def begin_step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Before an environment step, note whether the state was changed since the last one, or since the reset.

        It was also if a step between them raised an error after some of its timesteps.
        """
        if self._on and self._recorder is not None:
            self._moved = not np.array_equal(_state(model, data), self._seen, equal_nan=True)

    def end_step(
        self, model: mujoco.MjModel, data: mujoco.MjData, action: Any, reward: Any, terminated: bool, truncated: bool
    ) -> None:
        """Record the end of an environment step, after its last timestep."""
        if self._on and self._recorder is not None:
            self._recorder.end_step(action, reward, terminated=terminated, truncated=truncated)
            self._between, self._seen = True, _state(model, data)

    def finish(self) -> None:
        """Close the current file."""
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = None

    def _open(self, stepper: Stepper) -> Recorder:
        """Return the recorder of the current file; open a new file if there is none or the model has changed."""
        if self._recorder is not None and stepper.model is self._model:
            return self._recorder
        self.finish()
        path = self._claim()
        self._model = stepper.model
        try:
            self._recorder = Recorder(stepper.model, path, law=stepper.law, scene=self._scene, seed=self._seed)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        return self._recorder

    def _claim(self) -> Path:
        """Create a new, empty file and return its path; as it exists now, no other process can claim it."""
        if "env" in self._fields and self._env is None:
            self._env = next(number for number in count() if _made(self._named(number)))
            self._last = self._named(self._env)
            return self._last
        path = named = self._named(self._env or 0)
        models = self._models + 1 if named == self._last else 1
        if models > 1:
            path = named.with_name(f"{named.stem}-{models}{named.suffix}")
        if not _made(path):
            raise self._exists(path)
        self._last, self._models = named, models
        return path

    def _named(self, env: int) -> Path:
        return Path(self._path.format(env=env, episode=max(self._episode, 0)))

    def _exists(self, path: Path) -> RecordingError:
        given = Path(self._path)
        return RecordingError(
            f"{path} is there already, and environments do not write over recordings: delete it, choose another name, "
            f'or number them, as log="{given.with_name(f"{given.stem}-{{env}}{given.suffix}")}"'
        )


def episode_log(path: str | Path | None, every: int) -> EpisodeLog | None:
    """Return the log of an environment; None if path is None. Refuse an ``every`` that is no count, or lacks a path."""
    check_count("log_every", every)
    if path is None and every != 1:
        raise OptionError(f"log_every={every} means nothing without log")
    return None if path is None else EpisodeLog(path, every=every)


def _fields(path: str) -> set[str]:
    try:
        found = {name for _, name, _, _ in string.Formatter().parse(path) if name is not None}
        if found <= _FIELDS:
            path.format(env=0, episode=0)
            return found
    except (ValueError, IndexError):
        found = {path}
    raise OptionError(
        f"log={path!r} can have the fields {{env}} and {{episode}}, such as run-{{env}}-{{episode}}.rrd; braces that "
        "are part of a name are written twice"
    )


def _state(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return positions, velocities, activations, what delays remember, and the poses of mocap bodies."""
    state = np.empty(mujoco.mj_stateSize(model, int(_STATE)))
    mujoco.mj_getState(model, data, state, int(_STATE))
    return state


def _made(path: Path) -> bool:
    """Create an empty file if there is none; return whether it was created."""
    try:
        path.open("x").close()
    except FileExistsError:
        return False
    except OSError as error:
        raise RecordingError(f"cannot write the recording {path}: {error.strerror}") from None
    return True
