"""Coriolis and gyroscopic forces c, evaluated such that they create no energy of first order in the timestep h.

MuJoCo's integrators evaluate them at the velocity of the start, which creates such energy. Here they are evaluated at
the mean velocity of the step, in which contact is expected to have the same effect as in the last step. If a collision
makes the velocity jump and the mass matrix depends on the configuration, this creates energy again, since
``v^T c(v) = v^T (dM/dt) v / 2``. Then the collision is put between two half steps, each with its own mean velocity:

    v~- = v- - (h / 2) M^-1 c((v- + v~-) / 2)
    v~+ = v~- + M_h^-1 (h f + J^T Lambda)
    v+  = v~+ - (h / 2) M^-1 c((v~+ + v+) / 2)

(G. Strang, *On the construction and comparison of difference schemes*, SIAM J. Numer. Anal. 5, 1968.) The law is asked
for a jump from ``v~- + (v~+ - v+)`` to v+, in which contact does the same work as from v~- to v~+.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.stepping.plan import has_constant_inertia

ROUNDS = 6
"""Largest number of fixed point iterations; bodies that turn fast need several."""

SETTLED = 1e-2  # relative change of velocity below which the iteration ends
STILL = 1e-9  # m/s or rad/s: absolute change below which it also ends

FAST = 0.5
"""Rotation in a timestep, rad, above which the energy of a tree is checked."""

HALF_ROUNDS = 12
"""Largest number of iterations for the forces of half a step, which determine the energy of a collision."""

HALF_SETTLED = 1e-10  # relative change of these forces below which the iteration ends

SMALL_PART = 1e-2
"""Part of the energy created by a collision below which that of these forces is ignored: other forces create it."""
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_ROUND = 1e-9  # relative difference of moments of inertia that counts as rounding

INERTIA = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat", "tendon_armature")
"""Fields of mjModel whose change may introduce such forces."""


class InertialForces:
    """Whether there are such forces in a scene, ``M_h (v_free - v) = h (f - c(q_M, (v + v_free) / 2))``.

    Attributes:
        act: whether there are, according to the last `look`.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._looked = tuple(field for name in INERTIA if (field := getattr(model, name)).size)
        self._seen: list[bytes] = []
        self.act = False
        self.look()

    def __reduce__(self) -> tuple[type[InertialForces], tuple[mujoco.MjModel]]:
        """Make copies that look at the arrays of their own model."""
        return InertialForces, (self._model,)

    def look(self) -> bool:
        """Return whether there are such forces; if not so far, check again when a mass has changed.

        There are if the mass matrix depends on the configuration, or if a free body has unequal moments of inertia.
        """
        if not self.act:
            seen = [field.tobytes() for field in self._looked]
            if seen != self._seen:
                self._seen = seen
                self.act = not has_constant_inertia(self._model) or _is_uneven(self._model)
        return self.act


def _is_uneven(model: mujoco.MjModel) -> bool:
    """Return whether a free joint carries a body, including all bodies fixed to it, with unequal moments of inertia."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    inertia = data.crb[model.jnt_bodyid[model.jnt_type == _FREE], :6]  # xx yy zz xy xz yz
    differ = np.maximum(np.ptp(inertia[:, :3], axis=1), np.abs(inertia[:, 3:]).max(axis=1))
    return bool((differ > _ROUND * inertia[:, :3].max(axis=1)).any())
