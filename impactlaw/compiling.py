"""Several processes compile together: each function is compiled by one of them, and the others read it from the cache.

Helpers are Python processes that import what is about to be compiled, last functions first, and end with it. They
begin at the other end because the process that waits for all of it must compile in the order of the imports.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # on Windows there is none: each process compiles for itself
    fcntl = None

_HELPERS = 3  # of which each takes half a gigabyte
_WORK = "import sys; from impactlaw.compiling import help_with; help_with(*sys.argv[1:])"

LATER: ContextVar[list[Callable[[], Any]] | None] = ContextVar("LATER", default=None)
"""What a helper has put off until it has imported everything; None where functions are compiled as they are met."""


@dataclass(frozen=True)
class Declared:
    """A function that is going to be compiled, as those need it that call it by address, see `linked`."""

    function: Callable[..., Any]  # not compiled
    arguments: tuple[Any, ...]  # their types
    returned: Any  # type of what it returns


@contextmanager
def alone(path: Path | None, *, wait: bool = True) -> Iterator[bool]:
    """Hold a file that only one process can hold; what ends a process, however it ends, gives it back.

    Args:
        path: of the file; None if none can be written.
        wait: until another process gives it back.

    Yields:
        Whether it is held.
    """
    if fcntl is None or path is None:
        yield wait
        return
    with path.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:  # another process holds it, or its file system has no such thing
            yield wait
        else:
            yield True


def start_helpers(module: str, folder: Path) -> None:
    """Start processes that compile what a module of this package calls, as many as there are other processors.

    There are none where this Python cannot be started once more: then this process compiles alone.
    """
    if fcntl is None or not sys.executable or getattr(sys, "frozen", False):
        return
    from joblib import cpu_count  # it knows what part of the machine a container has

    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)}
    with suppress(OSError):
        for number in range(min(cpu_count() - 1, _HELPERS)):
            helper = subprocess.Popen(
                [sys.executable, "-P", "-c", _WORK, module, str(folder / f"helper_{number}.lock")],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            threading.Thread(target=helper.wait, daemon=True).start()  # somebody has to see it end


def help_with(module: str, lock: str) -> None:
    """Compile what a module calls, last functions first, but for those that another process is at."""
    with alone(Path(lock), wait=False) as mine:
        if not mine:
            return
        later: list[Callable[[], Any]] = []
        LATER.set(later)
        import_module(module)
        LATER.set(None)
        for compile_it in reversed(later):
            compile_it()
