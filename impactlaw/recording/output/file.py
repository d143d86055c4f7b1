"""The file of a recorder, and what is on its way there."""

from __future__ import annotations

import atexit
import ctypes
import os
import weakref
from pathlib import Path
from typing import Any

import mujoco

from impactlaw.errors import RecordingError
from impactlaw.recording import viewer
from impactlaw.recording.collisions import CollisionLog
from impactlaw.recording.episodes import EpisodeMarks
from impactlaw.recording.output.frames import Frames

_PATIENCE = 30.0  # s that the file may take for what is flushed, on a slow disk; rerun alone would wait for ever
_ROOM = 1 << 16  # bytes that a file has room for at least: more than rerun hands to it at once


class RecordingFile:
    """What has been written, and what has not yet.

    It does not know who fills it, so that it can be ended when that one is gone: `end_with`.

    Attributes:
        step: number of frames so far.
        clock: place of the last one on the timeline, s.
    """

    def __init__(self, path: Path, stream: Any, frames: Frames, marks: EpisodeMarks, collisions: CollisionLog):
        self.path, self.step, self.clock = path, 0, 0.0
        self.frames, self.marks, self.collisions = frames, marks, collisions
        self._stream: Any = stream
        self._process = os.getpid()

    @property
    def is_open(self) -> bool:
        """Whether it can be written to."""
        return self._stream is not None

    def open(self, model: mujoco.MjModel, *, view: bool) -> None:
        """Begin to write, before anything is logged.

        Rerun hands what it holds already to a new file, and waits for that: for ever if the disk is full. That is why
        the stream is as good as empty here, why there must be room for what it holds even so, and why the layout, which
        it would wait for as well, follows by itself.
        """
        import rerun as rr

        sinks = [viewer.spawn_viewer()] if view else []
        try:
            self.path.write_bytes(bytes(_ROOM))
            self._stream.set_sinks(rr.FileSink(self.path), *sinks)
        except (OSError, RuntimeError) as error:
            raise self._cannot_write(getattr(error, "strerror", None) or str(error)) from None
        viewer.send_blueprint(self._stream, model)
        self.sync()

    def flush(self) -> None:
        """Write all so far; after `close` this does nothing."""
        if self._stream is None:
            return
        first = self.step - len(self.frames)
        self.collisions.send(self._stream, self.clock)
        self.marks.send(self._stream)
        self.frames.send(self._stream, first)
        self.sync()

    def close(self) -> None:
        """Write what is left and end the file; a second call does nothing."""
        try:
            self.flush()
        finally:
            self._disconnect()

    def end_with(self, owner: Any) -> weakref.finalize:
        """Close when the owner is gone, or the interpreter ends; return what does it, and does nothing twice.

        The interpreter ends in the order of ``atexit``, last registered first, so that rerun, which is imported by
        now, still works. A process that was forked leaves the file to its parent.
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
            bindings.flush_and_cleanup_orphaned_recordings()  # or its threads go on until rerun is initialized again

    def sync(self) -> None:
        """Wait until the file has what was logged."""
        try:
            self._stream.flush(timeout_sec=_PATIENCE)
        except RuntimeError as error:
            if "gRPC" in str(error):  # a viewer that was closed is no loss to the file
                return
            if "timed out" in str(error):
                self._abandon()
            else:
                self._disconnect()
            raise self._cannot_write(str(error)) from None

    def _abandon(self) -> None:
        """Leave a stream that no longer answers, most likely since the disk is full.

        Whatever ends it would wait for ever: it must never be deleted, and rerun must not end it with the interpreter.
        """
        import rerun as rr

        rr.unregister_shutdown()
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._stream))
        self._stream = None

    def _cannot_write(self, reason: str) -> RecordingError:
        reason = reason.removeprefix("Failed to create file: ").partition(", path")[0]
        return RecordingError(f"cannot write the recording {self.path}: {reason}")
