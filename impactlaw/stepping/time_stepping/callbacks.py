"""Errors of the user's MuJoCo callbacks during a step, which must not pass through compiled code."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import get_ident, local
from typing import Any

import mujoco

from impactlaw.stepping.compiled.libmujoco import CALLBACKS, EXCHANGE, is_called_back

_CALLED = [name for name in CALLBACKS if name != "control"]  # by compiled code
_steps: list[int] = []  # threads in which steps are under way
_own: dict[str, tuple[Any, Any]] = {}  # the user's callbacks, and what stands in for them meanwhile
_errors = local()  # of the callbacks in a thread


def _errors_here() -> list[BaseException] | None:
    return getattr(_errors, "found", None)


def _careful(own: Any) -> Any:
    def call(*given: Any) -> Any:
        try:
            return own(*given)
        except BaseException as error:
            if _errors_here() is None:  # another thread's step does not concern this call
                raise
            _errors.found.append(error)
            return 0

    return call


@contextmanager
def errors_of_callbacks() -> Iterator[None]:
    """Raise exceptions of the user's callbacks at the end: within compiled code they would end the process."""
    outer, errors = _errors_here(), list[BaseException]()
    with EXCHANGE:
        if called := is_called_back():
            for name in _CALLED if not _steps else ():
                own = getattr(mujoco, f"get_mjcb_{name}")()
                if own is not None:
                    _own[name] = own, _careful(own)
                    getattr(mujoco, f"set_mjcb_{name}")(_own[name][1])
            _steps.append(get_ident())
    if not called:
        yield
        return
    _errors.found = errors
    try:
        yield
    finally:
        _errors.found = outer
        with EXCHANGE:
            _steps.remove(get_ident())
            for name in () if _steps else list(_own):
                own, careful = _own.pop(name)
                if getattr(mujoco, f"get_mjcb_{name}")() is careful:  # it has not been taken off meanwhile
                    getattr(mujoco, f"set_mjcb_{name}")(own)
    if errors:
        raise errors[0]
