"""One world of soft stepping in compiled code, and how a step has ended."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]

FINE = 0
PYTHON = 1
"""The scheme in Python is to take the step: data is where it was before."""
UNKNOWN = 2
"""The restitution of a contact is not known yet: data is where it was before."""
DIVERGED = 3
"""MuJoCo met a state that is not finite, or huge."""
CALLBACK = 4
"""A callback of MuJoCo is set; no step was taken."""


class Settings(NamedTuple):
    """What the collisions of one of many worlds are by, as places in a row of numbers; see `Law`.

    Attributes:
        restitution: e, where it is the same for all contacts; else NaN.
        sliding: tangential restitution.
        exact: 1 for exact Coulomb friction, 0 for its convex relaxation.
        last_exact: the same in a collision that ends the matter.
        rest_speed: closing speed above which a contact collides, m/s or rad/s.
        most: collisions at one instant after which one more ends the matter.
    """

    restitution: int = 0
    sliding: int = 1
    exact: int = 2
    last_exact: int = 3
    rest_speed: int = 4
    most: int = 5


SETTING = Settings()


class Law(NamedTuple):
    """What the collisions are by.

    Attributes:
        restitution: e, where it is the same for all contacts; else NaN.
        sliding: tangential restitution.
        exact: exact Coulomb friction, or its convex relaxation.
        last_exact: the same in a collision that ends the matter.
        frictional: whether contacts have friction.
        rest_speed: closing speed above which a contact collides, m/s or rad/s.
        most: collisions at one instant after which one more, of all contacts and with E = 0, ends the matter.
        key: of contacts and limits, see `law_table.Coefficients`, ascending, int64 (k,).
        value: e of each, (k,).
        asked: key of the contact that is not among them, int64 (1,), written.
        outcomes: their number, and the velocity after each collision, (1 + k nv,), written; (0,) to write none.
        bilateral: which equality constraints collisions keep, uint8 (neq,); (0,) if none.
    """

    restitution: float
    sliding: float
    exact: bool
    last_exact: bool
    frictional: bool
    rest_speed: float
    most: int
    key: Array
    value: Array
    asked: Array
    outcomes: Array
    bilateral: Array


class World(NamedTuple):
    """One world.

    Attributes:
        model: address of its model.
        data: address of its data.
        table: address of offsets of fields, see `compiled.fields`.
        nv: degrees of freedom.
    """

    model: int
    data: int
    table: int
    nv: int
