"""What both ways to step one world in compiled code share: the call, its argument, warnings and errors."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import warn_of_python
from impactlaw.stepping.compiled.engine import Entry, fill_context
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.compiled.layout import empty_stack, table
from impactlaw.stepping.compiled.libmujoco import callbacks, is_called_back
from impactlaw.stepping.integration import STEP_STATE, restore_state


class OneWorld:
    """Steps of one world in compiled code; a base class.

    Args:
        model: the scene.
        function: address of the C function that takes steps.
        places: indices of the numbers in its argument, by name.
        warn: whether to warn of steps in Python.
    """

    _coefficients: Coefficients
    _reason: str | None  # why no step is taken in compiled code under the law; None if steps are

    def __init__(self, model: Any, function: int, places: tuple[int, ...], *, warn: bool):
        self._model, self._function, self._places, self._warn = model, function, places, warn
        self._table, self._callbacks = table(), callbacks()
        self._context = np.zeros(len(places), np.int64)
        self._fields = memoryview(self._context.data)
        self._entry = None if is_called_back() else Entry(function, self._context)

    def _fill_context(self, arrays: dict[str, np.ndarray], numbers: dict[str, float]) -> None:
        """Write the addresses of arrays, and numbers, for compiled code; those of both ways to step are added."""
        arrays |= {"table": self._table, "callbacks": self._callbacks}
        arrays |= {"keys": self._coefficients.key, "values": self._coefficients.value}
        numbers |= {"model": self._model._address, "callback_count": len(self._callbacks)}
        fill_context(self._context, self._places, arrays, numbers | {"known": len(self._coefficients.key)})

    def _opened(self) -> Entry | None:
        """Return the entry into compiled code; None if steps are in Python, under this law or by MuJoCo's callbacks."""
        if self._reason is not None:
            return None
        if self._entry is None:
            if is_called_back():
                self._tell_of_callback()
                return None
            self._entry = Entry(self._function, self._context)
        return self._entry

    def _tell(self, why: str) -> None:
        """Warn of steps in Python, once."""
        if self._warn:
            self._warn = False
            warn_of_python(why)

    def _tell_of_callback(self) -> None:
        self._tell("a callback of MuJoCo is set")

    def _fail(self, data: Any, state: np.ndarray, message: str) -> None:
        """Restore a state, and raise MuJoCo's error."""
        empty_stack(data)
        restore_state(self._model, data, state, STEP_STATE)
        raise mujoco.FatalError(message)
