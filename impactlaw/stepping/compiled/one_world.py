"""What both ways to step one world in compiled code share: the call, its argument, and errors of MuJoCo."""

from __future__ import annotations

from functools import partial
from typing import Any

import mujoco
import numpy as np

from impactlaw.stepping.compiled.engine import Entry, fill_context
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.compiled.layout import empty_stack, structure_at, table
from impactlaw.stepping.compiled.libmujoco import callbacks, is_called_back, without_callbacks
from impactlaw.stepping.integration import STEP_STATE, restore_state


class OneWorld:
    """Steps of one world in compiled code; a base class.

    Args:
        model: the scene.
        function: address of the C function that takes steps.
        places: indices of the numbers in its argument, by name.
    """

    _coefficients: Coefficients

    def __init__(self, model: Any, function: int, places: tuple[int, ...]):
        self._model, self._function, self._places = model, function, places
        self._table, self._callbacks = table(), callbacks()
        self._context = np.zeros(len(places), np.int64)
        self._fields = memoryview(self._context.data)
        self._entry = None if is_called_back() else Entry(function, self._context)

    def _open(self) -> Entry:
        """Make the entry into compiled code while callbacks are set, and return it."""
        self._entry = without_callbacks(partial(Entry, self._function, self._context))
        return self._entry

    def _fill_context(self, arrays: dict[str, np.ndarray], numbers: dict[str, float]) -> None:
        """Write the addresses of arrays, and numbers, for compiled code; those of both ways to step are added."""
        arrays |= {"table": self._table, "callbacks": self._callbacks}
        arrays |= {"keys": self._coefficients.key, "values": self._coefficients.value}
        numbers |= {"model": structure_at(self._model), "callback_count": len(self._callbacks)}
        fill_context(self._context, self._places, arrays, numbers | {"known": len(self._coefficients.key)})

    def _fail(self, data: Any, state: np.ndarray, message: str) -> None:
        """Restore a state, and raise MuJoCo's error."""
        empty_stack(data)
        restore_state(self._model, data, state, STEP_STATE)
        raise mujoco.FatalError(message)
