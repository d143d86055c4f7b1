"""Arrays over the states and fields of many worlds, in the memory of MuJoCo's batches."""

from __future__ import annotations

import ctypes
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import UnknownNameError, UnsupportedError
from impactlaw.stepping.compiled.engine import Pool, functions
from impactlaw.stepping.compiled.layout import data_offset

_STATE = {
    "time": "TIME", "qpos": "QPOS", "qvel": "QVEL", "act": "ACT", "qacc_warmstart": "WARMSTART", "ctrl": "CTRL",
    "qfrc_applied": "QFRC_APPLIED", "xfrc_applied": "XFRC_APPLIED", "eq_active": "EQ_ACTIVE",
    "mocap_pos": "MOCAP_POS", "mocap_quat": "MOCAP_QUAT", "userdata": "USERDATA",
}  # fmt: skip

_OF_MODEL = "field of mjModel"


class Fields:
    """Live arrays over the states and fields of all worlds.

    Attributes:
        state: state vectors, one row per world, (nsim, nstate).
        outputs: the bound fields that compiled code copies out of mjData, see `compiled.entry.Worlds`.
    """

    def __init__(self, pool: Pool, model: mujoco.MjModel):
        self._pool, self._functions, self._data = pool, functions(), mujoco.MjData(model)
        self._model, self._known = model, {}
        self.outputs = np.zeros((0, 3), np.int64)
        self._width = self._functions.mjb_nstate(pool.handle)
        self.state = _numbers(pool, self._functions.mjb_state(pool.handle), (pool.worlds, self._width), np.dtype(float))

    def bind(self, name: str) -> np.ndarray:
        """Return a live array over a field of mjData of all worlds, (nsim, ..)."""
        if name in _STATE:
            return self._part(name)
        new = ("mjb_output", name) not in self._known
        found = self._array("mjb_output", name, self._data, "field of mjData", writeable=False)
        if new:
            output = data_offset(name), found.ctypes.data, found.nbytes // len(found)
            self.outputs = np.vstack([self.outputs, np.array([output], np.int64)])
        return found

    def expand(self, name: str) -> np.ndarray:
        """Give each world its own values of a field of mjModel, and return them, (nsim, ..)."""
        self._check_no_option(name)
        return self._array("mjb_expand", name, self._model, _OF_MODEL, writeable=True)

    def expanded(self, name: str) -> np.ndarray | None:
        """Return the array that `expand` made for a field, or None if it was not called for it."""
        if not _is_array(self._model, name):
            raise _unknown(self._model, name, _OF_MODEL)
        return self._known.get(("mjb_expand", name))

    def _check_no_option(self, name: str) -> None:
        option = name.removeprefix("opt.")
        if hasattr(self._model.opt, option) and not hasattr(self._model, option):
            instead = "; or expand body_gravcomp, the part of its weight that a body does not feel"
            raise UnsupportedError(
                f"{option} is an option of the model, which all worlds of a batch have in common, as it was when the "
                f"batch was made: make a batch for each value{instead if option == 'gravity' else ''}"
            )

    def write(self, world: int, data: Any) -> None:
        """Copy the bound fields that are not part of the state from data to the arrays of a world."""
        for offset, place, size in self.outputs.tolist():
            inside = data._address + abs(offset)
            source = inside if offset < 0 else ctypes.c_size_t.from_address(inside).value
            ctypes.memmove(place + size * world, source, size)

    def _part(self, name: str) -> np.ndarray:
        size = ctypes.c_int()
        kind = int(getattr(mujoco.mjtState, f"mjSTATE_{_STATE[name]}"))
        at = self._functions.mjb_stateComponent(self._pool.handle, kind, ctypes.byref(size)) or 0
        begin = (at - self.state.ctypes.data) // 8 if size.value else 0
        view = self.state[:, begin : begin + size.value]
        return view[:, 0] if name == "time" else view.reshape(len(view), *np.shape(getattr(self._data, name)))

    def _array(self, function: str, name: str, owner: Any, what: str, *, writeable: bool) -> np.ndarray:
        if (function, name) not in self._known:
            size, width = ctypes.c_int(), ctypes.c_int()
            get = getattr(self._functions, function)
            at = get(self._pool.handle, name.encode(), ctypes.byref(size), ctypes.byref(width))
            like = getattr(owner, name, None)
            if not at and isinstance(like, np.ndarray):
                raise UnsupportedError(f"{name!r} is a {what}, but one that MuJoCo's batches cannot bind or expand")
            if not at or not isinstance(like, np.ndarray):
                raise _unknown(owner, name, what)
            shape = (self._pool.worlds, *like.shape)
            found = _numbers(self._pool, at, shape, like.dtype)
            found.flags.writeable = writeable
            self._known[function, name] = found
        return self._known[function, name]


def _unknown(owner: Any, name: str, what: str) -> UnknownNameError:
    return UnknownNameError(what, name, [one for one in dir(owner) if _is_array(owner, one)])


def _is_array(owner: Any, name: str) -> bool:
    return not name.startswith("_") and isinstance(getattr(owner, name, None), np.ndarray)


def _numbers(pool: Pool, address: int, shape: tuple[int, ...], kind: np.dtype) -> np.ndarray:
    """Return an array over the pool's memory at an address; it keeps the pool alive as long as it is referenced."""
    size = int(np.prod(shape)) * kind.itemsize
    if size == 0:
        return np.zeros(shape, kind)
    place: Any = (ctypes.c_char * size).from_address(address)
    place.owner = pool
    return np.frombuffer(place, kind).reshape(shape)
