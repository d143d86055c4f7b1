"""Sizes, options and arrays of one world in compiled code.

A world is any named tuple with the addresses ``model``, ``data`` and ``table`` (of offsets, see `fields`), and ``nv``.
"""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.stepping.compiled.fields import (
    DATA,
    MODEL,
    SIZE,
    floats,
    int_at,
    ints,
    long_at,
    table_floats,
    table_ints,
)
from impactlaw.stepping.compiled.libmujoco import is_sparse


@plain
def offset(w, field):
    """Return where a field is in its structure, or how large a structure is, bytes."""
    return long_at(w.table + 8 * field)


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


@kernel
def jacobian_of(w):
    """Return entries of MuJoCo's rows, where they begin, their columns, and the entries; dense ones in full."""
    n = number(w, DATA.nefc)
    if is_sparse(w.model):
        many = number(w, DATA.nJ)
        nnz, adr = data_ints(w, DATA.efc_J_rownnz, n), data_ints(w, DATA.efc_J_rowadr, n)
        return nnz, adr, data_ints(w, DATA.efc_J_colind, many), data_floats(w, DATA.efc_J, many)
    nnz, adr, col = np.full(n, w.nv, np.int32), np.empty(n, np.int32), np.empty(n * w.nv, np.int32)
    for i in range(n):
        adr[i] = i * w.nv
        for k in range(w.nv):
            col[i * w.nv + k] = k
    return nnz, adr, col, data_floats(w, DATA.efc_J, n * w.nv)
