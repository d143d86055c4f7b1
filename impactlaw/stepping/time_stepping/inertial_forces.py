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

from impactlaw.stepping.compiled.libmujoco import add_tendon_bias
from impactlaw.stepping.compiled.whitening import Inertia, solve_inertia
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
_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_ROUND = 1e-9  # relative difference of moments of inertia that counts as rounding

INERTIA = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat", "tendon_armature")
"""Fields of mjModel whose change may introduce such forces."""


class InertialForces:
    """The forces of one scene, ``M_h (v_free - v) = h (f - c(q_M, (v + v_free) / 2))``.

    Attributes:
        act: whether there are such forces, according to the last `look`.
        used: the forces in the last `settle`, with gravity, (nv,).
        turning: trees of bodies that turn too fast for the timestep, or nearly so, bool (ntree,). If no mean velocity
            was found for a tree, the last step left its forces out.
        gravity: the force of gravity in the middle of the step, (nv,), if there are such trees.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._looked = tuple(field for name in INERTIA if (field := getattr(model, name)).size)
        self._seen: list[bytes] = []
        self.act = False
        self.look()
        self.used = self.gravity = np.zeros(model.nv)
        self.turning = np.zeros(model.ntree, dtype=bool)
        kind, place = model.jnt_type[model.dof_jntid], np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
        self._rotates = np.isin(kind, [_BALL, _HINGE]) | ((kind == _FREE) & (place >= 3))

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

    def settle(self, data: mujoco.MjData, start: np.ndarray, held: np.ndarray, metric: Inertia, h: float) -> np.ndarray:
        """Return the velocity without contact, (nv,)."""
        free, loose = data.qvel.copy(), np.ones(self._model.ntree, dtype=bool)
        self.turning = h * self._largest(np.where(self._rotates, start, 0.0)) > FAST
        for _ in range(ROUNDS):
            before, self.used = free, self.at(data, 0.5 * (start + free + held))
            free = self.lead_to(data, start, self.used, metric, h)
            loose = ~(self._largest(free - before) <= SETTLED * self._largest(free) + STILL)
            if not np.count_nonzero(loose):
                break
        self._watch(data, loose)
        if np.count_nonzero(loose):
            self.used = np.where(loose[self._model.dof_treeid], self.gravity, self.used)
            free = self.lead_to(data, start, self.used, metric, h)
        return free

    def _largest(self, vector: np.ndarray) -> np.ndarray:
        """Return the largest absolute value in each tree of bodies, (ntree,)."""
        largest = np.zeros(self._model.ntree)
        with np.errstate(invalid="ignore"):  # values that are not finite are found at the end of the step
            np.maximum.at(largest, self._model.dof_treeid, np.abs(vector))
        return largest

    def _watch(self, data: mujoco.MjData, loose: np.ndarray) -> None:
        """Add trees to those that turn too fast."""
        self.turning = self.turning | loose
        if np.count_nonzero(self.turning):
            self.gravity = self.at(data, np.zeros(self._model.nv))

    def at(self, data: mujoco.MjData, velocity: np.ndarray) -> np.ndarray:
        """Return the forces at a velocity, with gravity, (nv,)."""
        kept, bias = data.qvel.copy(), np.empty(self._model.nv)
        data.qvel[:] = velocity
        mujoco.mj_comVel(self._model, data)
        mujoco.mj_rne(self._model, data, 0, bias)
        if self._model.ntendon:
            add_tendon_bias(self._model, data, bias)
        data.qvel[:] = kept
        return bias

    def half(
        self, data: mujoco.MjData, velocity: np.ndarray, gravity: np.ndarray, metric: Inertia, h: float
    ) -> tuple[np.ndarray, bool]:
        """Return the forces in half a step that ends at a velocity, or begins there if h < 0, without gravity, (nv,).

        Also return whether the iteration has converged; if it diverges, forces may be infinite or not a number.
        """
        before = force = self.at(data, velocity) - gravity
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(HALF_ROUNDS):
                before, force = force, self.at(data, self.kick(velocity, force, metric, 0.25 * h)) - gravity
                if np.abs(force - before).max() <= HALF_SETTLED * np.abs(force).max():
                    return force, True
            largest = np.fmax.reduce(np.abs(force))
            self._watch(data, ~(self._largest(force - before) <= HALF_SETTLED * largest))
        return force, False

    def lead_to(
        self, data: mujoco.MjData, start: np.ndarray, bias: np.ndarray, metric: Inertia, h: float
    ) -> np.ndarray:
        """Return the velocity without contact, (nv,), for given inertial forces with gravity, (nv,); see `settle`."""
        return self.kick(start, data.qfrc_smooth + data.qfrc_bias - bias, metric, h)

    def kick(self, velocity: np.ndarray, force: np.ndarray, metric: Inertia, h: float) -> np.ndarray:
        """Return the velocity after a force has acted for a time h, (nv,)."""
        return velocity + h * solve_inertia(force, *metric)

    def created(self, data: mujoco.MjData, start: np.ndarray, h: float) -> float:
        """Return the kinetic energy that these forces create in a step from a velocity to that of data, J.

        It is the part of first order in h, due to the forces of the last `settle`.
        """
        after = data.qvel
        own = after @ self.at(data, after) + start @ data.qfrc_bias
        return 0.5 * h * float(own - (start + after) @ self.used)


def _is_uneven(model: mujoco.MjModel) -> bool:
    """Return whether a free joint carries a body, including all bodies fixed to it, with unequal moments of inertia."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    inertia = data.crb[model.jnt_bodyid[model.jnt_type == _FREE], :6]  # xx yy zz xy xz yz
    differ = np.maximum(np.ptp(inertia[:, :3], axis=1), np.abs(inertia[:, 3:]).max(axis=1))
    return bool((differ > _ROUND * inertia[:, :3].max(axis=1)).any())
