"""Joints that damping all but locks: contact acts on the inertia with which the step moves them.

MuJoCo's semi-implicit integrators advance by ``(M + h D)^-1``, but its contacts push on M: against the whole of a
damping force, of which the step then takes ``1 / (1 + h D / M)``. What is left of that push throws bodies apart, most
after a collision, which such a joint leaves fast. With ``M + h D`` in collisions and in forces of contact the free
motion is the same, and contact gets the acceleration that it asks for. That is what MuJoCo's integrator "discrete" does
for all that damps.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from impactlaw.stepping.integration import joint_inertia, locked_joints
from impactlaw.stepping.soft.tolerances import LOCKED

_PGS = int(mujoco.mjtSolver.mjSOL_PGS)
_DISCRETE = int(mujoco.mjtIntegrator.mjINT_DISCRETE)


def added_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray | None:
    """Return h D of such joints, 0 of others, (nv,), to be added to M while forces are found; None if nothing is.

    That is so where nothing touches, no joint is damped that much, the integrator is "discrete", or forces are found
    from what MuJoCo has made of M before: by its solver PGS, or in iterations without slip.
    """
    options = model.opt
    other = options.solver == _PGS or options.noslip_iterations > 0 or options.integrator == _DISCRETE
    added = None if other or not (data.ncon or data.nl) else joint_inertia(model)
    locked = locked_joints(model, added, LOCKED)
    return None if added is None or locked is None else np.where(locked, added, 0.0)


@contextmanager
def one_inertia(model: mujoco.MjModel, data: mujoco.MjData, added: np.ndarray) -> Iterator[None]:
    """Let the mass matrix of data, and its factor, be those of M with what is added to its diagonal, (nv,)."""
    kept = data.M.copy(), data.qLD.copy(), data.qLDiagInv.copy()
    data.M[model.M_rowadr + model.M_rownnz - 1] += added
    mujoco.mj_factorM(model, data)
    try:
        yield
    finally:
        data.M[:], data.qLD[:], data.qLDiagInv[:] = kept
