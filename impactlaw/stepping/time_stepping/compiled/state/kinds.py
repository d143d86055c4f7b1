"""Types of arguments of compiled functions with a single signature."""

from __future__ import annotations

from typing import Any, cast

import numba
import numpy as np
from numba import types

from impactlaw.stepping.time_stepping.compiled.state.law import LawTable
from impactlaw.stepping.time_stepping.compiled.state.room import Answer, Room
from impactlaw.stepping.time_stepping.compiled.state.world import World

typeof: Any = cast(Any, numba).typeof
INTEGER, BOOLEAN = types.int64, types.boolean
NUMBERS, MARKS = types.float64[::1], types.boolean[::1]
_FEW = np.zeros(0)
_MARKS, _KEYS = np.zeros(0, np.bool_), np.zeros(0, np.int64)
WORLD = typeof(World(0, 0, 0, 0, 0, 0, 0, 0, 0.0, False, 0, 0, 0))
ANSWER = typeof(Answer(*([_FEW] * 7), *([_MARKS] * 4)))
ROOM = typeof(Room(*([0] * len(Room.__annotations__))))
LAW = typeof(LawTable(_KEYS, _FEW, _KEYS))
