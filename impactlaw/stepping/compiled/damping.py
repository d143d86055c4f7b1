"""Whether the integrator of a scene damps implicitly, in compiled code."""

from __future__ import annotations

import mujoco

from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.fields import MODEL, floats, int_at, ints, long_at

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_POLYNOMIAL = 2  # number of coefficients of each degree of freedom, MuJoCo's mjNPOLY
_NO_DAMPING = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)


@plain
def _at(table, field):
    return long_at(table + 8 * field)


@plain
def is_damped(model, table):
    """Return whether the integrator of a copy of a model damps implicitly, with a mass matrix of its own."""
    if int_at(model + _at(table, MODEL.opt_integrator)) != _EULER:
        return True
    if int_at(model + _at(table, MODEL.opt_disableflags)) & _NO_DAMPING:
        return False
    nv, joints = long_at(model + _at(table, MODEL.nv)), long_at(model + _at(table, MODEL.njnt))
    damping = floats(long_at(model + _at(table, MODEL.dof_damping)), nv)
    more = floats(long_at(model + _at(table, MODEL.dof_dampingpoly)), _POLYNOMIAL * nv)
    for i in range(nv):
        if damping[i] != 0.0:
            return True
    for i in range(_POLYNOMIAL * nv):
        if more[i] != 0.0:
            return True
    actuator = ints(long_at(model + _at(table, MODEL.jnt_actuatorid)), joints)
    for i in range(joints):
        if actuator[i] != -1:
            return True
    return False
