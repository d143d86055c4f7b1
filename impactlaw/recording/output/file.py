"""The file of a recorder, with the buffers that are written to it."""

from __future__ import annotations

import atexit
import ctypes
import os
import weakref
from pathlib import Path
from secrets import token_hex
from typing import Any

import mujoco

from impactlaw.errors import RecordingError
from impactlaw.recording import viewer
from impactlaw.recording.collisions import CollisionLog
from impactlaw.recording.episodes import EpisodeMarks
from impactlaw.recording.output.frames import Frames

_PATIENCE = 30.0  # timeout of a flush to a slow disk, s; without it rerun would wait forever
_ROOM = 1 << 16  # bytes that must fit into a new file: more than rerun writes to it at once


class RecordingFile:
    """The open file of a recording, with the buffers of rows that are not written yet.

    It holds no reference to the recorder that fills it, so that it can be closed when the recorder is gone, see
    `end_with`.

    Attributes:
        step: number of frames so far.
        clock: time of the last frame on the timeline, s.
    """

    def __init__(self, path: Path, stream: Any, frames: Frames, marks: EpisodeMarks, collisions: CollisionLog):
        self.path, self.step, self.clock = path, 0, 0.0
        self.frames, self.marks, self.collisions = frames, marks, collisions
        self._stream: Any = stream
        self._process = os.getpid()

    @property
    def is_open(self) -> bool:
        """Whether the file can be written to."""
        return self._stream is not None

    def open(self, model: mujoco.MjModel, *, view: bool) -> None:
        """Open the file, before anything is logged.

        Rerun writes the data that a stream already holds to a new file and waits for it: forever, if the disk is full.
        Therefore the stream must be almost empty here, there must be room on the disk for the little that it holds, and
        the layout, for which rerun would also wait, is sent separately.
        """
        import rerun as rr

        sinks = [viewer.spawn_viewer()] if view else []
        try:
            _begin(self.path)
            self._stream.set_sinks(rr.FileSink(self.path), *sinks)
        except (OSError, RuntimeError) as error:
            raise self._cannot_write(getattr(error, "strerror", None) or str(error)) from None
        viewer.send_blueprint(self._stream, model)
        self.sync()

    def flush(self) -> None:
        """Write all buffered rows; this has no effect after `close`."""
        if self._stream is None:
            return
        first = self.step - len(self.frames)
        self.collisions.send(self._stream, self.clock)
        self.marks.send(self._stream)
        self.frames.send(self._stream, first)
        self.sync()

    def close(self) -> None:
        """Write all buffered rows and end the file; a second call has no effect."""
        try:
            self.flush()
        finally:
            self._disconnect()

    def end_with(self, owner: Any) -> weakref.finalize:
        """Close the file when its owner is garbage collected or the interpreter exits; return the finalizer.

        The finalizer closes the file only once. ``atexit`` runs the functions registered last first, so rerun, which is
        already imported, still works at that time. A forked process leaves the file to its parent.
        """
        end = weakref.finalize(owner, self._close_here)
        end.atexit = False
        atexit.register(end)
        return end

    def _close_here(self) -> None:
        if os.getpid() == self._process:
            self.close()

    def _disconnect(self) -> None:
        import rerun_bindings as bindings

        if self._stream is not None:
            self._stream.disconnect()
            self._stream = None
            bindings.flush_and_cleanup_orphaned_recordings()  # else its threads run until rerun is initialized again

    def sync(self) -> None:
        """Wait until the file holds everything that was logged."""
        try:
            self._stream.flush(timeout_sec=_PATIENCE)
        except RuntimeError as error:
            if "gRPC" in str(error):  # the viewer was closed, which does not affect the file
                return
            if "timed out" in str(error):
                self._abandon()
            else:
                self._disconnect()
            raise self._cannot_write(str(error)) from None

    def _abandon(self) -> None:
        """Abandon a stream that no longer responds, most likely because the disk is full.

        Ending the stream would wait forever. Therefore it must never be deleted, and rerun must not end it when the
        interpreter exits.
        """
        import rerun as rr

        rr.unregister_shutdown()
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._stream))
        self._stream = None

    def _cannot_write(self, reason: str) -> RecordingError:
        reason = reason.removeprefix("Failed to create file: ").partition(", path")[0]
        return RecordingError(f"cannot write the recording {self.path}: {reason}")


def _begin(path: Path) -> None:
    """Make the file, with room for its beginning, in the place of an old one.

    A recorder that still writes to the old one keeps that for itself. Else both would write to one file, which nobody
    could read, for instance where a cell of a notebook that makes a recorder is run again.
    """
    path = path.resolve()
    if not (path.is_file() and path.stat().st_size):
        path.write_bytes(bytes(_ROOM))
        return
    new = path.with_name(f".unfinished-{token_hex(4)}")
    try:
        new.write_bytes(bytes(_ROOM))
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)
