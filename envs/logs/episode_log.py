"""Recordings of an environment: which episodes, and in which files."""

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


class EpisodeLog:
    """Records every so many episodes of an environment, and never over a file that is there.

    ``run.rrd`` holds all of them. In ``run-{env}-{episode}.rrd``, where either part may be left out, ``{episode}`` is
    the number of the episode, which then has a file of its own, and ``{env}`` that of the environment: the first one
    from 0 on whose file is not there yet, so that each of several environments, and each later run, has its own. A file
    is made when its first episode begins. A model that the environment compiles later goes on in ``run-2.rrd``.

    Args:
        path: of the file, with these fields in it.
        every: record the episodes 0, ``every``, 2 ``every`` and so on.

    Attributes:
        path: as given.
        every: as given.

    Raises:
        OptionError: it is no path, or has other fields, or ``every`` is not a whole number of 1 or more.
        RecordingError: there is no such folder; or the path has no fields, and there is such a file.
    """

    def __init__(self, path: str | Path, *, every: int = 1):
        check_count("log_every", every)
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
        self._recorder: Recorder | None = None
        first = self._named(0)
        if not first.parent.is_dir():
            raise RecordingError(f"cannot write the recording {first}: there is no folder {first.parent}")
        if first.is_dir():
            raise RecordingError(f"{first} is a folder: log is the path of a file, such as {first / 'run.rrd'}")
        if not self._fields and first.exists():
            raise self._exists(first)

    def pause(self) -> None:
        """Record nothing until the next episode begins: a reset is on its way."""
        self._on, self._told = False, True

    def name_run(self, scene: str | None, seed: int | None, timesteps: int | None) -> None:
        """Tell what files that begin from now on say of the run: its environment, its seed, timesteps of a step."""
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
        """Begin an episode, whose start is in data.

        Args:
            stepper: by which it is stepped.
            data: the state at its start.
            options: by which that was made.
            seed: that it was reset with.
            generator: state of the random generator that it was drawn with.
        """
        self._episode += 1
        self._on = self._episode % self.every == 0
        if "episode" in self._fields:
            self.finish()
        if not self._on:
            return
        recorder = self._open(stepper)
        self._law = recorder.law = stepper.law
        settings, made = options.settings(stepper.law), how_made(options, stepper.model, self._timesteps)
        recorder.begin_episode(self._episode, seed=seed, generator=generator, settings=settings, made=made)
        recorder.step(data)

    def watch(self, stepper: Stepper, data: mujoco.MjData, options: LawOptions) -> None:
        """Look at the state before a timestep: where nobody tells of resets, time that goes back is one."""
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
            if after is None or after != before:  # not the same one made anew
                recorder.change_law(stepper.law, after)
        recorder.step(data, events)

    def end_step(self, action: Any, reward: Any, terminated: bool, truncated: bool) -> None:
        """Record an environment step, which the last timestep has ended."""
        if self._on and self._recorder is not None:
            self._recorder.end_step(action, reward, terminated=terminated, truncated=truncated)

    def finish(self) -> None:
        """End the file of now."""
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = None

    def _open(self, stepper: Stepper) -> Recorder:
        """Begin a file, unless the one of now is of the same model."""
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
        """Return the path of a file that was not there; it is now, so that nobody else takes it."""
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
    """Return the log of an environment; None if it has none.

    Raises:
        OptionError: the path has other fields, or ``every`` is not a whole number of 1 or more, or means nothing.
        RecordingError: there is no such folder; or the path has no fields, and there is such a file.
    """
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


def _made(path: Path) -> bool:
    """Make an empty file; return whether there was none."""
    try:
        path.open("x").close()
    except FileExistsError:
        return False
    except OSError as error:
        raise RecordingError(f"cannot write the recording {path}: {error.strerror}") from None
    return True
