"""Files that are all there in the end, or none of them."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from impactlaw.errors import SceneError

try:
    import fcntl
except ImportError:  # on Windows there is none: what a process leaves that is killed stays there
    fcntl = None

_UNFINISHED = ".unfinished-"


@contextmanager
def new_files_in(folder: Path) -> Iterator[Path]:
    """Give a temporary folder whose files move into ``folder`` at the end, or vanish if anything fails.

    What processes that were killed have left there is removed.
    """
    with ExitStack() as stack:
        try:
            made = [p for p in (folder, *folder.parents) if not p.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            with _held(folder):  # until the new one is held, too
                for path in filter(Path.is_dir, folder.glob(f"{_UNFINISHED}*")):
                    with _held(path, wait=False) as abandoned:
                        if abandoned:
                            shutil.rmtree(path, ignore_errors=True)
                temporary = Path(tempfile.mkdtemp(prefix=_UNFINISHED, dir=folder))
                stack.enter_context(_held(temporary))
        except OSError as error:
            raise SceneError(f"cannot write into {folder}: {error.strerror}") from None
        try:
            yield temporary
            written = list(temporary.iterdir())
            for path in written:  # all are looked at before the first one moves
                if (folder / path.name).is_dir():
                    raise SceneError(f"cannot write {folder / path.name}: there is a folder of that name")
            for path in written:
                path.replace(folder / path.name)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            with suppress(OSError):  # somebody else has put something there
                for path in made:
                    path.rmdir()
            raise
        temporary.rmdir()


@contextmanager
def _held(folder: Path, *, wait: bool = True) -> Iterator[bool]:
    """Hold a folder that only one process can hold; what ends a process, however it ends, gives it back."""
    if fcntl is None:
        yield False
        return
    place = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:  # another process holds it, or its file system has no such thing
            yield False
        else:
            yield True
    finally:
        os.close(place)
