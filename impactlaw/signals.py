"""Ctrl-C and SIGTERM as exceptions, so that unfinished files are removed, with a one-line message."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType
from typing import Any

_ENDS = {signal.SIGINT: ("interrupted", 130), signal.SIGTERM: ("terminated", 143)}
_SOON, _LATER = 0.1, 5.0
"""Times, s, after which the exit is raised again: if it is known to be lost, and if it may have been lost."""


if [PurePath(word).stem for word in sys.orig_argv[1:2]] == ["impactlaw"] and (
    signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else it is ignored, or somebody's own
):  # Ctrl-C ends the command at once while it is imported: KeyboardInterrupt would be a traceback, or an ImportError
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end the block by `SystemExit`, with one line on standard error and code 130 or 143.

    Python loses an exception that is raised while a finalizer runs, such as that of a rerun stream; it is raised again
    then. Errors that follow from the sudden end are not reported.
    """
    codes: list[int] = []
    tell = sys.unraisablehook

    def leave(*_: object) -> None:
        sys.exit(codes[0])

    def end(number: int, _: FrameType | None) -> None:
        word, code = _ENDS[signal.Signals(number)]
        codes.append(code)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # `timeout` sends two
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # a second Ctrl-C ends the process at once
        _repeat(leave, _LATER)
        print(f"impactlaw: {word}", file=sys.stderr)
        leave()

    def lose(lost: Any) -> None:
        if codes and lost.exc_type is SystemExit:
            _repeat(leave, _SOON)
        else:
            tell(lost)

    sys.unraisablehook = lose
    for number in _ENDS:
        if signal.getsignal(number) != signal.SIG_IGN:  # SIGINT is ignored in background processes
            signal.signal(number, end)
    try:
        yield
    except BaseException:
        if codes:
            leave()
        raise
    finally:
        if codes:
            _repeat(leave, 0.0)
        sys.unraisablehook = tell
    if codes:
        leave()


def _repeat(handler: Any, after: float) -> None:
    """Call a handler ``after`` seconds, and then every `_LATER` seconds; 0 stops the calls."""
    if hasattr(signal, "setitimer"):  # not on Windows
        signal.signal(signal.SIGALRM, handler)
        signal.setitimer(signal.ITIMER_REAL, after, _LATER if after else 0.0)
