"""Locks that one process at a time can hold; the end of a process, in any way, releases them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

HAS_LOCKS = fcntl is not None
"""Whether this system has such locks."""


@contextmanager
def alone(path: Path | None, *, wait: bool = True) -> Iterator[bool]:
    """Hold the lock of a folder, or of a file, which is created if it does not exist.

    Args:
        path: path of the folder or file; None if there is none.
        wait: whether to wait until another process releases the lock.

    Yields:
        Whether to go on: True if the lock is held. Where locks do not work, or none can be had, it is ``wait``.
    """
    if fcntl is None or path is None:
        yield wait
        return
    try:
        place = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:  # it does not exist and cannot be created, or another user has it
        yield wait
        return
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:  # another process holds it, or the file system has no locks
            yield wait
        else:
            yield True
    finally:
        os.close(place)
