"""Numba types of arguments, for compiled functions with a declared signature."""

from __future__ import annotations

from typing import Any, cast

import numba
import numpy as np

from impactlaw.stepping.soft.compiled.contacts.active_contacts import ActiveContacts
from impactlaw.stepping.soft.compiled.contacts.equalities import Gradients
from impactlaw.stepping.soft.compiled.contacts.rows import Rows
from impactlaw.stepping.soft.compiled.world import Law, Start, World

typeof: Any = cast(Any, numba).typeof
_FLOATS, _KEYS, _SHORT = np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int32)
WORLD = typeof(World(0, 0, 0, 0))
START = typeof(Start(0, _FLOATS, np.zeros((0, 2), np.int32)))
LAW = typeof(Law(0.0, 0.0, True, True, True, 0.0, 0, _KEYS, _FLOATS, _KEYS, _FLOATS, np.zeros(0, np.uint8), _FLOATS))
FOUND = typeof(ActiveContacts(_KEYS, _KEYS, _KEYS))
ROWS = typeof(Rows(_KEYS, _SHORT, _SHORT, _SHORT, _SHORT, _SHORT, _FLOATS))
GRADIENTS = typeof(Gradients((_SHORT, _SHORT, _SHORT, _FLOATS), _FLOATS, _FLOATS))
