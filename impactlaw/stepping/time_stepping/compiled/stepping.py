"""Time stepping of one world in compiled code, with the scheme in Python for what compiled code does not take."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import DivergenceError, InadmissibleImpactError
from impactlaw.stepping.impact_event import ImpactEvent
from impactlaw.stepping.integration import check_input, check_timestep, empty_state
from impactlaw.stepping.time_stepping.compiled import status
from impactlaw.stepping.time_stepping.compiled.borrow import room
from impactlaw.stepping.time_stepping.compiled.entry import CONTEXT, single
from impactlaw.stepping.time_stepping.compiled.fields import SIZE
from impactlaw.stepping.time_stepping.compiled.layout import table
from impactlaw.stepping.time_stepping.compiled.libmujoco import library
from impactlaw.stepping.time_stepping.compiled.memory import MEMORY, make_memory
from impactlaw.stepping.time_stepping.compiled.world import SETTING
from impactlaw.stepping.time_stepping.scheme import TimeStepping


class World:
    """The numbers and arrays that compiled code needs of one scene.

    Args:
        scheme: the scheme in Python, whose options it has.
    """

    def __init__(self, scheme: TimeStepping):
        model = self.model = scheme.model
        self.scheme = scheme
        self.table = table()
        self.settings = np.zeros(len(SETTING))
        self.sizes = scheme.sizes
        self.bilateral = scheme.bilateral.astype(np.uint8)
        self.keys, self.values = np.zeros(0, np.int64), np.zeros(0)
        self.set_law()
        self.numbers = model.nq + 2 * model.nv
        self.scratch: Any = mujoco.MjData(model)

    def set_law(self) -> None:
        """Take over the law and the options of the scheme."""
        self.settings[:] = self.scheme.settings()
        self.keys, self.values = np.zeros(0, np.int64), np.zeros(0)


def _address(array: np.ndarray) -> int:
    return array.ctypes.data


class CompiledStepping:
    """Time stepping in compiled code; see `scheme.TimeStepping`, whose attributes it has."""

    def __init__(self, scheme: TimeStepping):
        self._scheme, self._world = scheme, World(scheme)
        self._model: Any = scheme.model
        world, model = self._world, self._model
        self._memory = make_memory(world.numbers, 1)
        self._numbers = self._memory[0]
        self._counts = self._numbers.view(np.int64)
        self._state = empty_state(model)
        self._structure = np.zeros(int(world.table[SIZE.model]) // 8)
        self._margins = np.zeros(room(model))
        self._context = np.zeros(len(CONTEXT), np.int64)
        self._write_context()
        self._enter = _Entry()
        self.unlocated = 0

    def _write_context(self) -> None:
        world, c = self._world, self._context
        values = {
            "model": self._model._address, "scratch": world.scratch._address, "table": _address(world.table),
            "settings": _address(world.settings), "sizes": _address(world.sizes),
            "bilateral": _address(world.bilateral),
            "keys": _address(world.keys), "values": _address(world.values), "known": len(world.keys),
            "memory": _address(self._memory), "memories": self._memory.shape[1],
            "structure": _address(self._structure), "margins": _address(self._margins),
            "margin_count": len(self._margins), "state": _address(self._state), "states": len(self._state),
        }  # fmt: skip
        for name, value in values.items():
            c[getattr(CONTEXT, name)] = value

    @property
    def shortfall(self) -> float:
        return float(self._numbers[MEMORY.shortfall])

    @property
    def short_steps(self) -> int:
        return int(self._numbers[MEMORY.short_steps])

    @property
    def solved(self) -> bool:
        return bool(self._counts[MEMORY.solved])

    def step(self, data: mujoco.MjData) -> Callable[[], tuple[ImpactEvent, ...]] | tuple[()]:
        """Advance by one timestep."""
        c: Any = self._context
        c[CONTEXT.data] = data._address  # pyright: ignore[reportAttributeAccessIssue]
        self._enter(c.ctypes.data)
        if c[CONTEXT.status] != status.FINE:
            self._raise(int(c[CONTEXT.status]), data)
        return ()

    def _raise(self, how: int, data: mujoco.MjData) -> None:
        if how in (status.HUGE_INPUT, status.TIMESTEP):
            check_timestep(self._model.opt.timestep)
            check_input(self._model, data, self._state)
        if how == status.NOT_FINITE:
            raise DivergenceError(f"the forces at t = {data.time:.6g} s are not finite")
        if how == status.CREATES:
            raise InadmissibleImpactError("creates")
        raise DivergenceError(f"position or velocity is not finite, or huge, at t = {data.time:.6g} s")


class _Configuration(ctypes.Structure):
    _fields_ = [("nthread", ctypes.c_int), ("persistent", ctypes.c_uint8)]


class _Entry:
    """Calls compiled code so that an error of MuJoCo's engine is an exception: in a batch of one empty world."""

    def __init__(self):
        self._library, error = library(), ctypes.create_string_buffer(500)
        empty: Any = mujoco.MjModel.from_xml_string("<mujoco/>")
        make = self._library.mjb_makeBatch
        make.restype = ctypes.c_void_p
        make.argtypes = [ctypes.c_size_t, ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int]
        self._batch = make(empty._address, 1, ctypes.byref(_Configuration(1, 1)), error, 500)
        if not self._batch:
            raise mujoco.FatalError(error.value.decode())
        prototype = ctypes.CFUNCTYPE(
            ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int
        )
        apply = prototype(("mjb_apply", self._library))
        self._apply, self._address = apply, single.address

    def __call__(self, context: int) -> None:
        if self._apply(self._batch, None, 1, self._address, context, 0):
            text = self._library.mjb_error
            text.restype = ctypes.c_char_p
            text.argtypes = [ctypes.c_void_p, ctypes.c_int]
            raise mujoco.FatalError(text(self._batch, 0).decode())

    def __del__(self):
        if getattr(self, "_batch", None):
            self._library.mjb_deleteBatch.argtypes = [ctypes.c_void_p]
            self._library.mjb_deleteBatch(self._batch)
