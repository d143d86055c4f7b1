"""Writing a run into a rerun file, frame by frame."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import mujoco
import numpy as np

from impactlaw.errors import RecordingError
from impactlaw.recording import layout, viewer
from impactlaw.recording.collisions import CollisionLog
from impactlaw.recording.columns import Column
from impactlaw.recording.frames import Frames
from impactlaw.recording.geometry import Group, body_names, read_geometry
from impactlaw.recording.properties import encode, run_properties

if TYPE_CHECKING:
    from impactlaw.contacts import Contacts
    from impactlaw.events import ImpactEvent

BATCH = 200
"""Frames that are sent, and flushed to the file, together."""

_ARROW_TIME = 0.2  # s; an impulse is drawn as the path that it gives a body of mean mass in this time


class Recorder:
    """Records a run: geometry once, then poses, energies, closed contacts and collisions of every step.

    The file is a rerun recording (``rerun run.rrd`` shows it, `read_log` reads it) on the timeline ``sim_time``.
    Steps are flushed every `BATCH` of them; a run that is killed leaves all up to the last flush. A step whose time
    is not later than that of the step before begins a new episode; ``sim_time`` goes on from where it was.

    Poses and energies are computed on a private copy from the positions and velocities handed over, whatever state
    the derived quantities in ``data`` are in; ``data`` is only read.

    Args:
        model: the compiled scene.
        path: the file, overwritten if it exists.
        law: the impact law of the run, or its name; written to the file.
        restitution: its restitution where `law` is a name; taken from `law` where that is a `Law`.
        scene: name of the scene; the model's own name if not given.
        seed: seed of the run.
        view: also show the run in the rerun viewer as it happens, one flush behind.

    Raises:
        RecordingError: the file cannot be written, rerun is switched off, or there is no display to view on.
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
        self.path = Path(path)
        self._step = self._episode = 0
        self._time, self._clock, self._offset = -np.inf, 0.0, 0.0
        self._sizes = model.nq, model.nv
        self._stream: Any = None  # set when all is well
        properties = run_properties(model, law=law, restitution=restitution, scene=scene, seed=seed)
        groups = read_geometry(model)
        self._frames = Frames(model, groups, BATCH)
        arrow_scale = _ARROW_TIME / (model.stat.meanmass or 1.0)
        self._collisions = CollisionLog(model, properties["law"] or "", arrow_scale)
        stream = _new_stream()
        self._log_once(stream, groups, body_names(model), properties)
        self._open(stream, model, view)  # last: until here rerun holds everything in memory
        self._stream = stream

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def step(self, data: mujoco.MjData, events: Iterable[ImpactEvent] = (), contacts: Contacts | None = None) -> None:
        """Record the state after a simulation step.

        Args:
            data: the state; not changed.
            events: the collisions of the step.
            contacts: the contacts closed now; those of ``data.contact`` that touch if not given.

        Raises:
            RecordingError: the recorder is closed, the data are of another model, or the file can no longer be written.
        """
        if self._stream is None:
            raise RecordingError(f"the recording {self.path} is closed")
        if (data.qpos.size, data.qvel.size) != self._sizes:
            raise RecordingError(f"the data are not of the model that {self.path} records; a new model needs a new one")
        self._advance(data.time)
        for event in events:
            self._collisions.add(event, event.time + self._offset, episode=self._episode, step=self._step)
        self._frames.add(data, self._clock, contacts)
        self._step += 1
        if self._frames.is_full:
            self.flush()

    def flush(self) -> None:
        """Write all steps so far to the file; after `close` this does nothing.

        Raises:
            RecordingError: the file can no longer be written.
        """
        if self._stream is None:
            return
        first = self._step - len(self._frames)
        self._collisions.send(self._stream, self._clock)
        self._frames.send(self._stream, first)
        self._sync(self._stream)

    def close(self) -> None:
        """Write what is left and end the file; a second call does nothing.

        Raises:
            RecordingError: the file can no longer be written.
        """
        try:
            self.flush()
        finally:
            self._disconnect()

    def _advance(self, time: float) -> None:
        if time <= self._time:
            self._offset = self._clock
            self._episode += 1
        self._time = time
        self._clock = self._offset + time

    def _disconnect(self) -> None:
        if self._stream is not None:
            self._stream.disconnect()
            self._stream = None

    def _log_once(self, stream: Any, groups: list[Group], bodies: list[str], properties: dict[str, Any]) -> None:
        import rerun as rr

        for group in groups:
            names = Column(layout.GEOMETRY_BODIES, "texts", [[bodies[i] for i in group.bodies]])
            stream.log(group.path, group.archetype, static=True, strict=True)
            stream.send_columns(group.path, [], [names], strict=True)
            if group.fixed:
                stream.log(group.path, self._frames.initial_pose(group), static=True, strict=True)
        viewer.log_styles(stream)
        texts = {name: encode(value) for name, value in properties.items()}
        stream.send_property(layout.PROPERTIES, rr.AnyValues(drop_untyped_nones=True, **texts))

    def _open(self, stream: Any, model: mujoco.MjModel, view: bool) -> None:
        import rerun as rr

        sinks = [viewer.spawn_viewer()] if view else []
        try:
            stream.set_sinks(rr.FileSink(self.path), *sinks, default_blueprint=viewer.blueprint(model))
        except RuntimeError as error:
            raise self._cannot_write(error) from None
        self._sync(stream)

    def _sync(self, stream: Any) -> None:
        try:
            stream.flush()
        except RuntimeError as error:
            if "gRPC" not in str(error):  # a viewer that was closed is no loss to the file
                self._disconnect()
                raise self._cannot_write(error) from None

    def _cannot_write(self, error: RuntimeError) -> RecordingError:
        reason = str(error).removeprefix("Failed to create file: ").partition(", path")[0]
        return RecordingError(f"cannot write the recording {self.path}: {reason}")


def _new_stream() -> Any:
    import rerun as rr

    stream = rr.RecordingStream(layout.APPLICATION)
    if not rr.is_enabled(stream):
        raise RecordingError("rerun is switched off by the environment variable RERUN; unset it to record")
    return stream
