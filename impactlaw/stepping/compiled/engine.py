"""MuJoCo's thread pool, in which an error of its engine is reported instead of ending the process."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import mujoco
import numpy as np

from impactlaw.compiled import compiled
from impactlaw.stepping.compiled.fields import longs
from impactlaw.stepping.compiled.libmujoco import apply_to_worlds, library


class _Configuration(ctypes.Structure):
    _fields_ = (("nthread", ctypes.c_int), ("persistent", ctypes.c_uint8))


def functions() -> Any:
    """Return MuJoCo's library with the types of its functions for batches."""
    found, number, address = library(), ctypes.c_int, ctypes.c_void_p
    found.mjb_makeBatch.restype = address
    found.mjb_makeBatch.argtypes = [address, number, address, ctypes.c_char_p, number]
    found.mjb_apply.argtypes = [address, address, number, address, address, number]
    found.mjb_error.restype = ctypes.c_char_p
    found.mjb_error.argtypes = [address, number]
    found.mjb_deleteBatch.argtypes = [address]
    found.mjb_deleteBatch.restype = None
    found.mjb_nthread.argtypes = found.mjb_nstate.argtypes = found.mjb_state.argtypes = [address]
    found.mjb_state.restype = address
    found.mjb_stateComponent.restype = address
    found.mjb_stateComponent.argtypes = [address, number, ctypes.POINTER(number)]
    sizes = [ctypes.POINTER(number), ctypes.POINTER(number)]
    found.mjb_output.restype = found.mjb_expand.restype = address
    found.mjb_output.argtypes = found.mjb_expand.argtypes = [address, ctypes.c_char_p, *sizes]
    found.mjb_reset.argtypes = [address, address, number, address, number]
    found.mjb_forward.argtypes = [address, address, number, number]
    found.mjb_getData.argtypes = found.mjb_getModel.argtypes = [address, number, address]
    found.mjb_status.restype = address
    found.mjb_status.argtypes = [address]
    found.mj_deleteData.argtypes = [address]
    return found


def when_gone(owner: Any, function: Callable[..., Any], *arguments: Any) -> None:
    """Call a function when an object is deleted, but not at the end of the process, which frees everything itself."""
    weakref.finalize(owner, function, *arguments).atexit = False


class Pool:
    """MuJoCo's thread pool with several worlds of a model.

    Args:
        model: the model of all worlds.
        worlds: number of worlds.
        threads: number of threads; 0 for one per processor.
        persistent: whether each world has its own data.

    Raises:
        mujoco.FatalError: MuJoCo cannot make the pool.
    """

    def __init__(self, model: Any, worlds: int, threads: int, *, persistent: bool):
        self._functions, message = functions(), ctypes.create_string_buffer(500)
        configuration = _Configuration(threads, persistent)
        self.worlds = worlds
        self.handle = self._functions.mjb_makeBatch(model._address, worlds, ctypes.byref(configuration), message, 500)
        if not self.handle:
            raise mujoco.FatalError(message.value.decode())
        when_gone(self, self._functions.mjb_deleteBatch, self.handle)
        self._call = self._functions.mjb_apply

    def apply(self, function: int, argument: int, worlds: Any) -> int:
        """Call a C function for some worlds, int32 (k,), and keep the states that it leaves.

        Return the number of worlds for which MuJoCo has raised an error.
        """
        return self._call(self.handle, worlds.ctypes.data, len(worlds), function, argument, True)

    @property
    def threads(self) -> int:
        """Number of threads, including the caller's."""
        return self._functions.mjb_nthread(self.handle)

    def write_model(self, world: int, model: Any) -> None:
        """Copy the model of a world to the given model."""
        self._functions.mjb_getModel(self.handle, world, model._address)

    def error(self, world: int) -> str:
        """Return MuJoCo's error message of a world in the last call."""
        return self._functions.mjb_error(self.handle, world).decode()


@cache
def _empty_model() -> Any:
    return mujoco.MjModel.from_xml_string("<mujoco/>")


def one_world() -> Pool:
    """Return a pool with one empty world, in milliseconds; it calls MuJoCo's control callback if there is one."""
    return Pool(_empty_model(), 1, 1, persistent=True)


def _enter(place, data):
    """Call a C function for the only world of a pool; return what it has written second into its argument.

    Before, the address of the data is written first into it. The result is -1 if MuJoCo has raised an error.
    """
    pool, function, argument = longs(place, 3)
    context = longs(argument, 2)
    context[0] = data
    return -1 if apply_to_worlds(pool, 0, np.int32(1), function, argument, np.int32(0)) else context[1]


@cache
def _entry_point() -> Any:
    """Return `_enter` compiled, as a function that does not look at the types of its arguments."""
    (made,) = compiled("int64(int64,int64)", counts=False)(_enter).overloads.values()
    return made.entry_point


class Entry:
    """The entry of one world into compiled code: a pool calls its C function, and reports the errors of MuJoCo.

    For the price of making it see `one_world`.

    Args:
        function: address of the C function.
        context: its argument, int64, see `_enter`; kept by the caller.

    Attributes:
        call: function of the address of a world's data, see `_enter`.
    """

    def __init__(self, function: int, context: np.ndarray):
        self._pool = one_world()
        self._arguments = np.array([self._pool.handle, function, context.ctypes.data])
        self.call = partial(_entry_point(), self._arguments.ctypes.data)

    @property
    def message(self) -> str:
        """MuJoCo's error message of the last call."""
        return self._pool.error(0)


def delete_others(slots: np.ndarray) -> None:
    """Delete the other data of each thread, see `pooled.other_data`."""
    for _, other in slots:
        if other:
            functions().mj_deleteData(int(other))


def fill_context(
    context: np.ndarray, places: tuple[int, ...], arrays: dict[str, np.ndarray], numbers: dict[str, float]
) -> None:
    """Write numbers, and the addresses of arrays, to their places in the argument of compiled code."""
    for name, value in ({name: array.ctypes.data for name, array in arrays.items()} | numbers).items():
        context[getattr(places, name)] = value
