"""Joints that damping holds: integrated implicitly they are all but locked, which impulses of contact do not know.

MuJoCo's semi-implicit integrators advance by ``(M + tau D)^-1``, but collisions and held contact move bodies by
``M^-1``. Where ``tau D`` is many times M, what contact does to such a joint is gone after a step: as if it had been
locked, and servos that answer to it within a step can feed the motion. Time stepping has D in its mass matrix.
"""

from __future__ import annotations

import mujoco
import numpy as np

_LOCKED = 1e4  # tau D / M, at the configuration in which the scene was compiled
_EULER, _RK4 = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_RK4)
_NONE, _EXPLICIT = int(mujoco.mjtDisableBit.mjDSBL_DAMPER), int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)


def locks(model: mujoco.MjModel, timestep: float) -> bool:
    """Return whether damping all but locks a joint."""
    integrator = int(model.opt.integrator)
    if integrator == _RK4 or model.opt.disableflags & (_NONE | (_EXPLICIT if integrator == _EULER else 0)):
        return False
    return bool(np.count_nonzero(timestep * model.dof_damping > _LOCKED * model.dof_M0))
