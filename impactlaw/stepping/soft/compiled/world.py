"""One world of soft stepping in compiled code, its law, and the status of a step."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]

FINE = 0
PYTHON = 1
"""The scheme in Python has to take the step; data is as it was before."""
UNKNOWN = 2
"""The restitution of a contact is not known yet; data is as it was before."""
DIVERGED = 3
"""MuJoCo met a state that is not finite, or huge."""
CALLBACK = 4
"""A callback of MuJoCo is set; no step was taken."""


class Settings(NamedTuple):
    """The law and options of one of many worlds, as indices of a row of numbers; see `Law`."""

    restitution: int = 0  # e if it is the same for all contacts; else NaN
    sliding: int = 1  # tangential restitution
    exact: int = 2  # 1 for exact Coulomb friction, 0 for its convex relaxation
    last_exact: int = 3  # the same for the last collision after `most` others
    rest_speed: int = 4  # closing speed above which a contact collides, m/s or rad/s
    most: int = 5  # largest number of collisions at one instant, before the last one


SETTING = Settings()


class Law(NamedTuple):
    """The law and options of collisions."""

    restitution: float  # e if it is the same for all contacts; else NaN
    sliding: float  # tangential restitution
    exact: bool  # whether friction is exact Coulomb friction, or else its convex relaxation
    last_exact: bool  # the same for the last collision after `most` others
    frictional: bool  # whether contacts have friction
    rest_speed: float  # closing speed above which a contact collides, m/s or rad/s
    most: int  # largest number of collisions at one instant; after these, a last one with E = 0 involves all contacts
    key: Array  # keys of contacts and limits, see `law_table.Coefficients`, ascending, int64 (k,)
    value: Array  # e for each key, (k,)
    asked: Array  # key of a contact that is not in `key`, int64 (1,), written
    # how many numbers tell the collisions, also if there is no room for them, then these numbers, see
    # `outcomes.Outcome`, (1 + k,), written; (0,) if not wanted
    outcomes: Array
    # kinds of equality constraints, 0 for those that do not keep their velocity in collisions, uint8 (neq,); (0,) if no
    # equality constraint keeps it
    bilateral: Array
    # remaining part of the work that the collisions of an instant may take, see `solvers.cones.budget.spend`, (1,),
    # written; once it is used up, problems are solved by one attempt each, restitution is not searched any further, and
    # the next collision is the last one
    left: Array


class World(NamedTuple):
    """One world."""

    model: int  # address of its model
    data: int  # address of its data
    table: int  # address of offsets of fields, see `compiled.fields`
    nv: int  # number of degrees of freedom


class Start(NamedTuple):
    """Where the contacts a step before are known from; see `soft.pressed_contacts`."""

    data: int  # address of other data, to be changed, for the contacts where the velocity has come from; or 0
    state: Array  # the state, see `integration.STEP_STATE`
    pairs: Array  # or else geoms of the contacts, int32 (n, 2)
