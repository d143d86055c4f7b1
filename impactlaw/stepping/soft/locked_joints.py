"""Joints that damping all but locks: contact acts on the inertia ``M + h D`` with which the step moves them.

MuJoCo's semi-implicit integrators advance by ``(M + h D)^-1``, but its contact forces are computed with M. They balance
the whole damping force, of which the step then takes only the part ``1 / (1 + h D / M)``; the rest of the contact force
throws bodies apart, most of all after a collision, which such a joint leaves fast. With ``M + h D`` in collisions and
in contact forces the free motion stays the same, and contacts get the acceleration that they ask for. MuJoCo's
integrator "discrete" does the same for all kinds of damping.
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


def added_inertia(model: mujoco.MjModel) -> np.ndarray | None:
    """Return h D for such joints and 0 for others, (nv,), to be added to M; None if no joint is damped that much."""
    added = joint_inertia(model)
    locked = locked_joints(model, added, LOCKED)
    return None if added is None or locked is None else np.where(locked, added, 0.0)


def inertia_of_forces(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray | None:
    """Return `added_inertia` where contact forces are computed with it.

    It is also None if no contact or limit touches, with the integrator "discrete", and if MuJoCo computes forces from
    results that it has derived from M before: with its solver PGS, or with ``noslip_iterations``.
    """
    options = model.opt
    other = options.solver == _PGS or options.noslip_iterations > 0 or options.integrator == _DISCRETE
    return None if other or not (data.ncon or data.nl) else added_inertia(model)


@contextmanager
def with_locked_joints(model: mujoco.MjModel, data: mujoco.MjData, added: np.ndarray) -> Iterator[None]:
    """Add `added`, (nv,), to the diagonal of the mass matrix of data within the context, and factorize it again."""
    kept = data.M.copy(), data.qLD.copy(), data.qLDiagInv.copy()
    data.M[model.M_rowadr + model.M_rownnz - 1] += added
    mujoco.mj_factorM(model, data)
    try:
        yield
    finally:
        data.M[:], data.qLD[:], data.qLDiagInv[:] = kept
