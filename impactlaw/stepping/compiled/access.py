"""Sizes, options and arrays of one world in compiled code.

A world is any named tuple with the addresses ``model``, ``data`` and ``table`` (of offsets, see `fields`), and ``nv``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from impactlaw.solvers.cones.algebra.loops import integers, kernel, numbers, once, plain
from impactlaw.stepping.compiled.fields import CONTACT, DATA, MODEL, SIZE, floats, int_at, ints, long_at
from impactlaw.stepping.compiled.libmujoco import is_sparse
from impactlaw.stepping.compiled.whitening import Inertia


@plain
def offset(w, field):
    """Return the offset of a field in its structure, or the size of a structure, bytes."""
    return long_at(w.table + 8 * field)


@plain
def size(w, field):
    """Return a size of the model."""
    return long_at(w.model + offset(w, field))


@plain
def option(w, field):
    """Return an integer option of the model."""
    return int_at(w.model + offset(w, field))


@plain
def number(w, field):
    """Return an integer of data."""
    return np.int64(int_at(w.data + offset(w, field)))


@plain
def model_at(w, field):
    """Return the address of an array of the model."""
    return long_at(w.model + offset(w, field))


@plain
def data_at(w, field):
    """Return the address of an array of data."""
    return long_at(w.data + offset(w, field))


def _arrays(address: Any, read: Any) -> Any:
    """Return a compiled function that returns an array of a world, given its field and its shape."""

    @kernel
    def of(w, field, shape):
        return read(address(w, field), shape)

    return of


model_ints, model_floats = (_arrays(model_at, read) for read in (ints, floats))
data_ints, data_floats = (_arrays(data_at, read) for read in (ints, floats))


def _of_rows(read: Any) -> Any:
    """Return a compiled function that returns a field of MuJoCo's rows of constraints, (nefc,)."""

    @kernel
    def of(w, field):
        return read(w, field, number(w, DATA.nefc))

    return of


row_ints, row_floats = _of_rows(data_ints), _of_rows(data_floats)


def _of_contacts(read: Any, width: int) -> Any:
    """Return a compiled function that returns a field of MuJoCo's contacts with entries of some bytes, (ncon, many)."""

    @kernel
    def of(w, field, many):
        stride, first = offset(w, SIZE.contact) // width, offset(w, field) // width
        return read(data_at(w, DATA.contact), (number(w, DATA.ncon), stride))[:, first : first + many]

    return of


contact_ints, contact_floats = _of_contacts(ints, 4), _of_contacts(floats, 8)


@kernel
def velocity_of(w):
    """Return qvel, (nv,)."""
    return floats(data_at(w, DATA.qvel), w.nv)


@kernel
def layout_of(w):
    """Return the number of entries of each row of the mass matrix, the index of the first entry, and the columns."""
    return (
        model_ints(w, MODEL.M_rownnz, w.nv),
        model_ints(w, MODEL.M_rowadr, w.nv),
        model_ints(w, MODEL.M_colind, size(w, MODEL.nC)),
    )


@kernel
def inertia_of(w):
    """Return MuJoCo's `Inertia`, without implicit damping."""
    nnz, adr, col = layout_of(w)
    return Inertia(data_floats(w, DATA.qLD, len(col)), data_floats(w, DATA.qLDiagInv, w.nv), nnz, adr, col)


@kernel
def layout_of_trees(w):
    """Return the tree of each degree of freedom, and first degree of freedom and number of these for each tree."""
    many = size(w, MODEL.ntree)
    first = model_ints(w, MODEL.tree_dofadr, many)
    return model_ints(w, MODEL.dof_treeid, w.nv), first, model_ints(w, MODEL.tree_dofnum, many)


@kernel
def contacts_of(w):
    """Return gaps, points, frames and geoms of MuJoCo's contacts."""
    gap, geom = contact_floats(w, CONTACT.dist, 1)[:, 0], contact_ints(w, CONTACT.geom, 2)
    return gap, contact_floats(w, CONTACT.pos, 3), contact_floats(w, CONTACT.frame, 9), geom


@kernel
def shapes_of(w):
    """Return MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat."""
    n = size(w, MODEL.ngeom)
    shapes = model_ints(w, MODEL.geom_type, n), model_floats(w, MODEL.geom_size, (n, 3))
    return *shapes, data_floats(w, DATA.geom_xpos, (n, 3)), data_floats(w, DATA.geom_xmat, (n, 9))


@kernel
def bodies_of(w):
    """Return MuJoCo's geom_bodyid, body_weldid and body_treeid."""
    n, body = size(w, MODEL.nbody), model_ints(w, MODEL.geom_bodyid, size(w, MODEL.ngeom))
    return body, model_ints(w, MODEL.body_weldid, n), model_ints(w, MODEL.body_treeid, n)


@plain
def _number_columns(nnz, adr, col, nv):
    """Write the number of entries of dense rows, the index of the first entry, and the columns."""
    for i in range(len(nnz)):
        nnz[i], adr[i] = nv, i * nv
        for k in range(nv):
            col[i * nv + k] = k


@plain
def _leave_out_zeros(dense, nv, nnz, adr, col, val):
    """Write the nonzero entries of dense rows, their number, the index of the first entry, and their columns."""
    end = 0
    for i in range(len(nnz)):
        adr[i] = end
        for k in range(nv):
            if dense[i * nv + k] != 0.0:
                val[end], col[end] = dense[i * nv + k], k
                end += 1
        nnz[i] = end - adr[i]


@once
def jacobian_of(w, zeros):
    """Return number of entries and first entry of MuJoCo's rows, columns, and entries.

    Dense rows include their `zeros`, so that all rows of a contact have the same columns, or only their nonzero
    entries. The result is valid as long as the calling function runs.
    """
    n, sparse = number(w, DATA.nefc), is_sparse(w.model)
    many = number(w, DATA.nJ) if sparse else n * w.nv
    val = data_floats(w, DATA.efc_J, many)
    rows, entries = (0, 0) if sparse else (n, many)
    nnz, adr, col, kept = integers(rows), integers(rows), integers(entries), numbers(0 if zeros else entries)
    if sparse:
        nnz, adr = data_ints(w, DATA.efc_J_rownnz, n), data_ints(w, DATA.efc_J_rowadr, n)
        col = data_ints(w, DATA.efc_J_colind, many)
    elif zeros:
        _number_columns(nnz, adr, col, w.nv)
    else:
        _leave_out_zeros(val, w.nv, nnz, adr, col, kept)
        val = kept
    return nnz, adr, col, val
