"""Write a run into a rerun file, frame by frame."""

from __future__ import annotations

import atexit
import json
import numbers
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np

from impactlaw.errors import RecordingError
from impactlaw.recording import layout, viewer
from impactlaw.recording.collisions import CollisionLog
from impactlaw.recording.episodes import EpisodeMarks
from impactlaw.recording.geometry import Group, body_names, read_geometry
from impactlaw.recording.layout import EPISODE_COLUMNS, Column
from impactlaw.recording.output.file import RecordingFile
from impactlaw.recording.output.frames import Frames
from impactlaw.recording.properties import law_name, run_properties
from impactlaw.recording.rrd import file_path
from impactlaw.scene.contacts import Contacts
from impactlaw.stepping.compatibility import check_model
from impactlaw.stepping.impact_event import ImpactEvent

BATCH = 200
"""Number of frames that are sent and flushed to the file together."""

_ARROW_TIME = 0.2  # s; an impulse is drawn as the distance that it moves a body of mean mass in this time


class Recorder:
    """A recorder of a run: geometry once, then state, poses, energies, closed contacts and collisions of every step.

    The file is a rerun recording (``rerun run.rrd`` shows it, `read_log` reads it) on the timeline ``sim_time``. Every
    `BATCH` steps are flushed to the file; if a run is killed, the file holds all steps up to the last flush. `close`
    ends the file. If it is not called, the file ends when the recorder is garbage collected or the interpreter exits.

    If `begin_episode` is never called, a step whose time is not later than that of the previous step begins a new
    episode. ``sim_time`` continues to increase across episodes.

    Poses and energies are computed on a private copy, from the positions and velocities in ``data``. The derived
    quantities in ``data`` may be outdated; ``data`` is only read.

    Args:
        model: the compiled scene.
        path: the file, replaced if it exists; what an older recorder still writes to that is lost with it.
        law: the impact law of the run, or its name; written to the file.
        restitution: the restitution, if `law` is a name; if it is a `Law`, its own restitution is the default.
        scene: name of the scene; the model's own name if not given.
        seed: seed of the run.
        view: also show the run live in the rerun viewer, one flush behind.

    Raises:
        SceneError: model is not a `mujoco.MjModel`.
        RecordingError: the file cannot be written, an argument is no plain value, rerun is switched off, or there is no
            display to view on.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        path: str | Path,
        *,
        law: Any = None,
        restitution: Any = None,
        scene: str | Path | None = None,
        seed: int | None = None,
        view: bool = False,
    ):
        check_model(model)
        self.path = file_path(path)
        self._episode = -1
        self._coming: dict[str, Any] | None = None
        self._changes: dict[str, dict[str, Any]] = {}  # of law and model, with the next frame
        self._told = False  # whether `begin_episode` has been called
        self._time, self._offset = -np.inf, 0.0
        self._sizes = model.nq, model.nv
        properties = run_properties(model, law=law, restitution=restitution, scene=scene, seed=seed)
        texts = {name: _plain_text(name, value) for name, value in properties.items()}
        groups = read_geometry(model)
        self._frames = Frames(model, groups)
        arrow_scale = _ARROW_TIME / (model.stat.meanmass or 1.0)
        self._marks = EpisodeMarks()
        self._collisions = CollisionLog(model, properties["law"] or "", arrow_scale)
        stream = _new_stream()
        self._file = RecordingFile(self.path, stream, self._frames, self._marks, self._collisions)
        self._file.open(model, view=view)
        self._log_once(stream, groups, body_names(model), texts)
        self._file.sync()
        self._end = self._file.end_with(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def law(self) -> str | None:
        """The law in one line, as recorded with collisions; assign a `Law` or a name to change it from now on."""
        return self._collisions.law or None

    @law.setter
    def law(self, law: Any) -> None:
        self._collisions.law = law_name(law) or ""

    def begin_episode(
        self,
        number: int | None = None,
        *,
        seed: int | None = None,
        generator: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        made: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin an episode with the next frame.

        Args:
            number: number of the episode; by default the number of the last episode plus one.
            seed: seed of the reset.
            generator: state of the random generator from which the episode was drawn, as plain values.
            settings: law and options of its steps, as plain values.
            made: description of how the environment was made, as plain values.

        Raises:
            RecordingError: number or seed is not a whole number, or one of the others is not a mapping of plain values.
        """
        plain = {"generator": generator, "settings": settings, "made": made}
        self._coming = {
            "number": self._episode + 1 if number is None else _whole("number", number),
            "seed": None if seed is None else _whole("seed", seed),
            **{name: None if value is None else _mapping(name, value) for name, value in plain.items()},
        }
        self._told = True

    def change_law(self, law: Any, value: Any = None) -> None:
        """Change the law from the next frame on, within the episode.

        Args:
            law: a `Law` or its name.
            value: the law as plain values.

        Raises:
            RecordingError: value does not consist of plain values.
        """
        plain = None if value is None else _plain_text("value", value)
        self.law = law
        self._changes[layout.CHANGES] = {"law": self.law, "value": plain}

    def change_model(self, made: Mapping[str, Any]) -> None:
        """Record that the model was changed within the episode, from the next frame on.

        Args:
            made: description of how the environment steps now, as for `begin_episode`.

        Raises:
            RecordingError: made is not a mapping of plain values.
        """
        self._changes[layout.MODELS] = {"made": _mapping("made", made)}

    def change_state(self) -> None:
        """Record that the next step starts from another state than that of the last frame, within the episode."""
        self._changes[layout.STATES] = {"changed": True}

    def end_step(self, action: Any, reward: Any, *, terminated: bool = False, truncated: bool = False) -> None:
        """Record action, reward and end of an environment step, whose last timestep is the last frame.

        Raises:
            RecordingError: no frame has been recorded, the recorder is closed, the action does not consist of numbers,
                or the reward is not one number.
        """
        file = self._opened()
        if not file.step:
            raise RecordingError(f"an environment step ends with a frame, but {self.path} has none yet")
        self._marks.end_step(file.clock, file.step - 1, action, reward, (terminated, truncated))

    def step(self, data: mujoco.MjData, events: Iterable[ImpactEvent] = (), contacts: Contacts | None = None) -> None:
        """Record the state after a simulation step.

        Args:
            data: the state; not modified.
            events: the collisions of the step.
            contacts: the closed contacts; by default the touching ones of ``data.contact``.

        Raises:
            RecordingError: the recorder is closed, data belongs to another model, the file can no longer be written, or
                an argument is something else.
        """
        file, events = self._opened(), _checked(data, events, contacts)
        if (data.qpos.size, data.qvel.size) != self._sizes:
            raise RecordingError(f"the data are not of the model that {self.path} records; a new model needs a new one")
        self._advance(data.time)
        for event in events:
            self._collisions.add(event, event.time + self._offset, episode=self._episode, step=file.step)
        self._frames.add(data, file.clock, contacts)
        file.step += 1
        if len(self._frames) == BATCH:
            self.flush()

    def flush(self) -> None:
        """Write all steps so far to the file; this has no effect after `close`.

        Raises:
            RecordingError: the file can no longer be written.
        """
        self._file.flush()

    def close(self) -> None:
        """Write all remaining steps and end the file; a second call has no effect.

        Raises:
            RecordingError: the file can no longer be written.
        """
        atexit.unregister(self._end)
        self._end.detach()
        self._file.close()

    def _opened(self) -> RecordingFile:
        if not self._file.is_open:
            raise RecordingError(f"the recording {self.path} is closed")
        return self._file

    def _advance(self, time: float) -> None:
        file, again = self._file, time <= self._time
        if again:
            self._offset = file.clock
        self._time = time
        file.clock = self._offset + time
        if self._coming is None and (not file.step or (again and not self._told)):
            self._coming = dict.fromkeys(EPISODE_COLUMNS) | {"number": self._episode + 1}
        if self._coming is not None:
            self._episode = self._coming["number"]
            self._marks.add(layout.EPISODES, file.clock, file.step, {**self._coming, "law": self.law})
            self._coming = None
        for path, cells in self._changes.items():
            self._marks.add(path, file.clock, file.step, cells)
        self._changes.clear()

    def _log_once(self, stream: Any, groups: list[Group], bodies: list[str], texts: dict[str, str]) -> None:
        import rerun as rr

        for group in groups:
            names = Column(layout.GEOMETRY_BODIES, "texts", [[bodies[i] for i in group.bodies]])
            stream.log(group.path, group.archetype, static=True, strict=True)
            stream.send_columns(group.path, [], [names], strict=True)
            if group.fixed:
                stream.log(group.path, self._frames.initial_pose(group), static=True, strict=True)
        viewer.log_styles(stream)
        stream.send_property(layout.PROPERTIES, rr.AnyValues(drop_untyped_nones=True, **texts))


def _checked(data: Any, events: Any, contacts: Any) -> tuple[ImpactEvent, ...]:
    """Return the collisions of a step after checking that a step consists of these."""
    if not isinstance(data, mujoco.MjData):
        raise RecordingError(f"a step is recorded from its mujoco.MjData, got {data!r:.80}: step(data, stepper.events)")
    told: tuple[Any, ...] = tuple(events) if isinstance(events, Iterable) else (events,)
    if not all(isinstance(event, ImpactEvent) for event in told):
        raise RecordingError(f"the collisions of a step are stepper.events, got {events!r:.80}")
    if contacts is not None and not isinstance(contacts, Contacts):
        raise RecordingError(f"the contacts of a step are impactlaw.Contacts, got {contacts!r:.80}")
    return told


def _whole(name: str, value: Any) -> int:
    """Return the number or the seed of an episode, which rerun stores in 64 bits."""
    if not isinstance(value, numbers.Integral) or not -(2**63) <= int(value) < 2**63:
        raise RecordingError(f"the {name} of an episode is a whole number of at most 64 bits, got {value!r:.80}")
    return int(value)


def _mapping(name: str, value: Any) -> str:
    """Return a mapping of plain values as JSON."""
    if not isinstance(value, Mapping):
        raise RecordingError(f"a recording takes a mapping of plain values as {name}, got {value!r:.80}")
    return _plain_text(name, dict(value))


def _plain_text(name: str, value: Any) -> str:
    """Return plain values as JSON."""
    try:
        return json.dumps(value)
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"a recording takes plain values as {name} (numbers, texts, lists, mappings), got {value!r:.80}: {error}"
        ) from None


def _new_stream() -> Any:
    import rerun as rr

    stream = rr.RecordingStream(layout.APPLICATION)
    if not rr.is_enabled(stream):
        raise RecordingError("rerun is switched off by the environment variable RERUN; unset it to record")
    return stream
