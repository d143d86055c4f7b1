"""Joints that damping all but locks, in compiled code: contact acts on ``M + h D``, see `soft.locked_joints`."""

from __future__ import annotations

import mujoco

from impactlaw.solvers.cones.algebra.loops import plain, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, layout_of, model_floats, model_ints, offset, option, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, float_at
from impactlaw.stepping.soft.tolerances import LOCKED

_PGS = int(mujoco.mjtSolver.mjSOL_PGS)
_EULER, _RK4 = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_RK4)
_NONE, _EXPLICIT = int(mujoco.mjtDisableBit.mjDSBL_DAMPER), int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)


@plain
def _damped(w):
    """Return h, and of each degree of freedom D, M, the entry of ``M^-1``, and 0 if others are coupled to it, (nv,)."""
    h = float_at(w.model + offset(w, MODEL.opt_timestep))
    damping, inertia = model_floats(w, MODEL.dof_damping, w.nv), model_floats(w, MODEL.dof_M0, w.nv)
    return h, damping, inertia, model_floats(w, MODEL.dof_invweight0, w.nv), model_ints(w, MODEL.dof_simplenum, w.nv)


@plain
def _is_locked(added, inertia, effect, simple):
    return added > LOCKED * inertia or (simple == 0 and added * effect > LOCKED)


@plain
def locks(w):
    """Return whether damping all but locks a joint; see `integration.locked_joints`."""
    h, damping, inertia, effect, simple = _damped(w)
    some = False
    for i in range(w.nv):
        some = some or _is_locked(h * damping[i], inertia[i], effect[i], simple[i])
    integrator, off = option(w, MODEL.opt_integrator), option(w, MODEL.opt_disableflags)
    implicit = integrator != _RK4 and not off & _NONE and not (integrator == _EULER and off & _EXPLICIT)
    return some and implicit


@plain
def takes_forces(w):
    """Return whether MuJoCo finds forces from the mass matrix of data alone; see `locked_joints.inertia_of_forces`."""
    return option(w, MODEL.opt_solver) != _PGS and option(w, MODEL.opt_noslip_iterations) == 0


@plain
def room(w):
    """Return the number of entries that `lock` saves."""
    return 2 * size(w, MODEL.nC) + w.nv


@plain
def lock(w, kept):
    """Add h D of such joints to the mass matrix, and factorize it; save the old values into `kept`, (`room`,)."""
    entries = size(w, MODEL.nC)
    h, damping, inertia, effect, simple = _damped(w)
    matrix = data_floats(w, DATA.M, entries)
    nnz, adr, _ = layout_of(w)
    put(kept, matrix)
    put(kept[entries:], data_floats(w, DATA.qLD, entries))
    put(kept[2 * entries :], data_floats(w, DATA.qLDiagInv, w.nv))
    for i in range(w.nv):
        if _is_locked(h * damping[i], inertia[i], effect[i], simple[i]):
            matrix[adr[i] + nnz[i] - 1] += h * damping[i]
    mj.factor_m(w.model, w.data)


@plain
def unlock(w, kept):
    """Restore the mass matrix and its factor from `kept`."""
    entries = size(w, MODEL.nC)
    put(data_floats(w, DATA.M, entries), kept[:entries])
    put(data_floats(w, DATA.qLD, entries), kept[entries : 2 * entries])
    put(data_floats(w, DATA.qLDiagInv, w.nv), kept[2 * entries :])
