"""What a step in Python shares with functions of compiled steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from threading import get_ident, local
from typing import Any

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.stepping.compiled.engine import Pool, one_world
from impactlaw.stepping.compiled.layout import table
from impactlaw.stepping.compiled.libmujoco import CALLBACKS, EXCHANGE, is_called_back, without_callbacks
from impactlaw.stepping.time_stepping.compiled.midpoint import find_sizes
from impactlaw.stepping.time_stepping.compiled.state.surfaces import HEAD, surface_room
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, World

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


class WorldMemory:
    """The arrays at the addresses in a `World`, for steps in Python.

    Attributes:
        motion: motion of mocap bodies, see `compiled.state.surfaces`.
        work: remaining part of the work allowed in the step, (1,), see `solvers.cones.budget.spend`.
    """

    def __init__(self, model: mujoco.MjModel, carriers: np.ndarray, motion: np.ndarray | None = None):
        self._model: Any = model
        self._sizes, self.work, self._carriers = np.zeros(model.nbody + model.nmocap), np.ones(1), carriers
        self._bilateral, self._table, self._settings = constraint_kinds(model), table(), np.zeros(len(SETTING))
        self.motion = np.zeros(surface_room(model)) if motion is None else motion
        if motion is None and model.nmocap:
            self.motion[HEAD.time] = np.nan

    def __reduce__(self) -> tuple[type[WorldMemory], tuple[mujoco.MjModel, np.ndarray, np.ndarray]]:
        """Make copies with memory of their own."""
        return WorldMemory, (self._model, self._carriers, self.motion.copy())

    @cached_property
    def _scratch(self) -> Any:
        return mujoco.MjData(self._model)

    @cached_property
    def _pool(self) -> Pool:
        with without_callbacks():
            return one_world()

    def error(self) -> mujoco.FatalError:
        """Return the error that MuJoCo has raised in compiled code, see `compiled.shared`."""
        self.__dict__.pop("_scratch", None)  # its stack may still be in use
        return mujoco.FatalError(self._pool.error(0))

    def world(self, data: Any, settings: Sequence[float], *, damped: bool) -> World:
        """Return the world of a step, which begins here."""
        model = self._model
        self.work[0], self._settings[:] = 1.0, settings
        w = World(
            model._address, data._address, self._scratch._address, self._table.ctypes.data, self._settings.ctypes.data,
            self._sizes.ctypes.data, self._bilateral.ctypes.data, model.nv, model.opt.timestep, damped,
            self.motion.ctypes.data if self._settings[SETTING.surfaces] else 0, self.work.ctypes.data,
            self._pool.handle,
        )  # fmt: skip
        for_python(find_sizes)(w, self._sizes, self._carriers.ctypes.data)
        return w
