"""Laws in compiled code: one coefficient of restitution per contact, from a table by the keys of contacts."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impactlaw.solvers.cones.loops import kernel
from impactlaw.stepping.time_stepping.compiled.status import FINE, UNKNOWN

Array = np.ndarray[Any, Any]


class LawTable(NamedTuple):
    """A law whose contacts know their own restitution.

    Attributes:
        key: of contacts and limits, see `rows.Rows`, ascending, int64 (k,).
        value: e of each, (k,).
        asked: key of the contact that is not among them, int64 (1,), written.
    """

    key: Array
    value: Array
    asked: Array


@kernel
def ask_law(law, rows, tree, collides, target):
    """Write the law's targets of the contacts that collide, and return `status.FINE`, or `status.UNKNOWN`."""
    for g in range(len(target)):
        if not collides[g]:
            continue
        at = np.searchsorted(law.key, rows.key[g])
        if at == len(law.key) or law.key[at] != rows.key[g]:
            law.asked[0] = rows.key[g]
            return UNKNOWN
        target[g] = -law.value[at] * rows.rates[1, rows.groups[0, g]]
    return FINE
