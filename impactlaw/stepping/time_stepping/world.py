"""What a step in Python shares with functions of compiled steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from impactlaw.scene.equality_constraints import constraint_kinds
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.compiled.engine import Pool, one_world
from impactlaw.stepping.compiled.layout import table
from impactlaw.stepping.compiled.libmujoco import without_callbacks
from impactlaw.stepping.time_stepping.compiled.state.surfaces import surface_room, write_motion
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, World


@contextmanager
def errors_of_filter() -> Iterator[None]:
    """Raise exceptions of the user's filter of contacts at the end: within compiled code they would end the process."""
    own, errors = mujoco.get_mjcb_contactfilter(), list[BaseException]()
    if own is None:
        yield
        return

    def careful(*given: Any) -> int:
        try:
            return own(*given)
        except BaseException as error:
            errors.append(error)
            return 0

    mujoco.set_mjcb_contactfilter(careful)
    try:
        yield
    finally:
        mujoco.set_mjcb_contactfilter(own)
    if errors:
        raise errors[0]


class WorldMemory:
    """The arrays at the addresses in a `World`, for steps in Python.

    Attributes:
        sizes: see `margins.write_sizes`, (nbody,).
        work: remaining part of the work allowed in the step, (1,), see `solvers.cones.budget.spend`.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model: Any = model
        self.sizes, self.work = np.zeros(model.nbody), np.ones(1)
        self._bilateral, self._motion = constraint_kinds(model), np.zeros(surface_room(model))
        self._table, self._settings = table(), np.zeros(len(SETTING))

    def __reduce__(self) -> tuple[type[WorldMemory], tuple[mujoco.MjModel]]:
        """Make copies with memory of their own."""
        return WorldMemory, (self._model,)

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

    def world(self, data: Any, settings: Sequence[float], surfaces: Surfaces | None, *, damped: bool) -> World:
        """Return the world of a step, which begins here."""
        model, motion = self._model, 0
        self.work[0], self._settings[:] = 1.0, settings
        if surfaces is not None:
            write_motion(self._motion, surfaces)
            motion = self._motion.ctypes.data
        return World(
            model._address, data._address, self._scratch._address, self._table.ctypes.data, self._settings.ctypes.data,
            self.sizes.ctypes.data, self._bilateral.ctypes.data, model.nv, model.opt.timestep, damped, motion,
            self.work.ctypes.data, self._pool.handle,
        )  # fmt: skip
