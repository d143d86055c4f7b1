"""One world in compiled code: a model of its own for the step, its data, and what the scheme has been told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.stepping.time_stepping.compiled.structures.fields import (
    DATA,
    MODEL,
    SIZE,
    float_at,
    floats,
    int_at,
    ints,
    long_at,
    table_floats,
    table_ints,
)


class Settings(NamedTuple):
    """What the scheme has been told, as places in a row of numbers.

    Attributes:
        rest_speed: least closing speed of a collision, m/s or rad/s.
        sliding: tangential restitution.
        exact: 1 for exact Coulomb friction, 0 for its convex relaxation.
        dissipative: what is done with energy that a law would create: 1 to scale restitution, 0 to let it, -1 to stop.
        frictional: 1 where contacts have friction.
        inertial: 1 where Coriolis or gyroscopic forces act.
        sticks: 1 where something sticks across gaps.
        forces: 1 where forces are written as MuJoCo's own cones have them.
        restitution: e, where it is the same for all contacts; else NaN.
        reversal: e of a law that reverses contact velocities along the contacts' order; else NaN.
    """

    rest_speed: int = 0
    sliding: int = 1
    exact: int = 2
    dissipative: int = 3
    frictional: int = 4
    inertial: int = 5
    sticks: int = 6
    forces: int = 7
    restitution: int = 8
    reversal: int = 9


SETTING = Settings()


class World(NamedTuple):
    """One world, and what a step has found out about it.

    Attributes:
        model: address of its model, whose options and margins are those of the step.
        data: address of its data.
        scratch: address of other data, for looks at contacts that data is not to show.
        table: address of offsets of fields, see `fields`.
        settings: address of `Settings`.
        sizes: address of `margins.body_sizes`, m, (nbody,).
        bilateral: address of which equality constraints a collision must not violate, uint8 (neq,).
        nv: degrees of freedom.
        timestep: h, s.
        damped: whether the integrator damps implicitly.
    """

    model: int
    data: int
    scratch: int
    table: int
    settings: int
    sizes: int
    bilateral: int
    nv: int
    timestep: float
    damped: bool


@plain
def offset(w, field):
    """Return where a field is in its structure, or how large a structure is, bytes."""
    return long_at(w.table + 8 * field)


@plain
def setting(w, place):
    """Return one of `Settings`."""
    return float_at(w.settings + 8 * place)


@plain
def size(w, field):
    """Return a size of the model."""
    return long_at(w.model + offset(w, field))


@plain
def option(w, field):
    """Return an int among the options of the model."""
    return int_at(w.model + offset(w, field))


@plain
def number(w, field):
    """Return an int of data."""
    return np.int64(int_at(w.data + offset(w, field)))


@plain
def model_at(w, field):
    """Return where an array of the model begins."""
    return long_at(w.model + offset(w, field))


@plain
def data_at(w, field):
    """Return where an array of data begins."""
    return long_at(w.data + offset(w, field))


@kernel
def model_ints(w, field, n):
    """Return an array of the model, int32 (n,)."""
    return ints(model_at(w, field), n)


@kernel
def model_floats(w, field, n):
    """Return an array of the model, (n,)."""
    return floats(model_at(w, field), n)


@kernel
def data_ints(w, field, n):
    """Return an array of data, int32 (n,)."""
    return ints(data_at(w, field), n)


@kernel
def data_floats(w, field, n):
    """Return an array of data, (n,)."""
    return floats(data_at(w, field), n)


@kernel
def velocity_of(w):
    """Return qvel, (nv,)."""
    return floats(data_at(w, DATA.qvel), w.nv)


@kernel
def layout_of(w):
    """Return entries of each row of the mass matrix, where they begin, and their columns."""
    return (
        model_ints(w, MODEL.M_rownnz, w.nv),
        model_ints(w, MODEL.M_rowadr, w.nv),
        model_ints(w, MODEL.M_colind, size(w, MODEL.nC)),
    )


@kernel
def metric_of(w):
    """Return L and ``1 / D`` of the mass matrix of the step."""
    entries = size(w, MODEL.nC)
    if w.damped:
        return data_floats(w, DATA.qH, entries), data_floats(w, DATA.qHDiagInv, w.nv)
    return data_floats(w, DATA.qLD, entries), data_floats(w, DATA.qLDiagInv, w.nv)


@kernel
def rows_of(w, place, entries, columns):
    """Return fields of data that are a table of doubles, (rows, columns)."""
    return table_floats(data_at(w, place), entries, columns)


@kernel
def contact_ints(w, field, many):
    """Return a field of MuJoCo's contacts, int32 (ncon, many)."""
    stride = offset(w, SIZE.contact) // 4
    first = offset(w, field) // 4
    return table_ints(data_at(w, DATA.contact), number(w, DATA.ncon), stride)[:, first : first + many]


@kernel
def contact_floats(w, field, many):
    """Return a field of MuJoCo's contacts, (ncon, many)."""
    stride = offset(w, SIZE.contact) // 8
    first = offset(w, field) // 8
    return table_floats(data_at(w, DATA.contact), number(w, DATA.ncon), stride)[:, first : first + many]
