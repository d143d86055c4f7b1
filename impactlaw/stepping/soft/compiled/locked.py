"""Joints that damping all but locks: in a collision they have the inertia with which the step moves them."""

from __future__ import annotations

import mujoco

from impactlaw.solvers.cones.algebra.loops import clear, plain, put
from impactlaw.stepping.compiled.access import (
    data_floats,
    layout_of,
    model_floats,
    model_ints,
    offset,
    option,
    size,
)
from impactlaw.stepping.compiled.damping import is_damped
from impactlaw.stepping.compiled.fields import DATA, MODEL, float_at
from impactlaw.stepping.soft.tolerances import LOCKED

_RK4, _IMPLICIT = int(mujoco.mjtIntegrator.mjINT_RK4), int(mujoco.mjtIntegrator.mjINT_IMPLICIT)


@plain
def _factorize(factor, inverse, nnz, adr, col):
    """Overwrite a matrix by L and D of ``L^T D L``, and write ``1 / D``, as MuJoCo's `mj_factorM` does."""
    for k in range(len(inverse) - 1, -1, -1):
        begin, end = adr[k], adr[k] + nnz[k] - 1
        inverse[k] = 1.0 / factor[end]
        for a in range(end - 1, begin - 1, -1):
            part, i = factor[a] * inverse[k], col[a]
            for j in range(nnz[i]):
                factor[adr[i] + j] -= factor[begin + j] * part
        for a in range(begin, end):
            factor[a] *= inverse[k]


@plain
def _add_diagonal(w, added):
    """Add the diagonal of ``M_h - M`` to zeros, (nv,), where the factor of M_h is that of the last step."""
    entries = size(w, MODEL.nC)
    M, factor = data_floats(w, DATA.M, entries), data_floats(w, DATA.qH, entries)
    inverse = data_floats(w, DATA.qHDiagInv, w.nv)
    nnz, adr, col = layout_of(w)
    for k in range(w.nv):
        end = adr[k] + nnz[k] - 1
        for a in range(adr[k], end):
            added[col[a]] += factor[a] * factor[a] / inverse[k]
        added[k] += 1.0 / inverse[k] - M[end]


@plain
def write_added(w, added):
    """Write what damping adds to the diagonal of M, (nv,); see `integration.implicit_inertia`."""
    integrator, h = option(w, MODEL.opt_integrator), float_at(w.model + offset(w, MODEL.opt_timestep))
    clear(added)
    if integrator == _RK4 or not is_damped(w.model, w.table):
        return
    if integrator == _IMPLICIT:
        adr, diagonal = model_ints(w, MODEL.D_rowadr, w.nv), model_ints(w, MODEL.D_diag, w.nv)
        derivative = data_floats(w, DATA.qDeriv, size(w, MODEL.nD))
        for i in range(w.nv):
            added[i] = -h * derivative[adr[i] + diagonal[i]]
        return
    inverse, damping = data_floats(w, DATA.qHDiagInv, w.nv), model_floats(w, MODEL.dof_damping, w.nv)
    made = True
    for i in range(w.nv):
        made = made and inverse[i] != 0.0
    if made:
        _add_diagonal(w, added)
        return
    for i in range(w.nv):  # there was no step yet
        added[i] = h * damping[i]


@plain
def locks(w, added):
    """Return whether damping all but locks a joint; see `integration.locked_joints`."""
    inertia, some = model_floats(w, MODEL.dof_M0, w.nv), False
    write_added(w, added)
    for i in range(w.nv):
        some = some or added[i] > LOCKED * inertia[i]
    return some


@plain
def lock(w, added, kept):
    """Let the factor of the mass matrix be that of M, plus h D for such joints; keep what it was, (nC + nv,)."""
    entries, inertia = size(w, MODEL.nC), model_floats(w, MODEL.dof_M0, w.nv)
    factor, inverse = data_floats(w, DATA.qLD, entries), data_floats(w, DATA.qLDiagInv, w.nv)
    nnz, adr, col = layout_of(w)
    put(kept, factor)
    put(kept[entries:], inverse)
    put(factor, data_floats(w, DATA.M, entries))
    for i in range(w.nv):
        if added[i] > LOCKED * inertia[i]:
            factor[adr[i] + nnz[i] - 1] += added[i]
    _factorize(factor, inverse, nnz, adr, col)


@plain
def unlock(w, kept):
    """Let the factor of the mass matrix be what it was."""
    entries = size(w, MODEL.nC)
    put(data_floats(w, DATA.qLD, entries), kept[:entries])
    put(data_floats(w, DATA.qLDiagInv, w.nv), kept[entries:])
