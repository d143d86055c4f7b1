"""Coriolis and gyroscopic forces c, such that no energy of first order in the timestep h comes of them.

MuJoCo's integrators evaluate them at the velocity of the start, which makes such energy. Here they are those of the
mean velocity of the step, in which contact is expected to do what it did in the step before. Where a collision makes
the velocity jump, that makes energy again if the mass matrix depends on the configuration, for
``v^T c(v) = v^T (dM/dt) v / 2``. Then the collision is between two half steps, each with its own mean:

    v~- = v- - (h / 2) M^-1 c((v- + v~-) / 2)
    v~+ = v~- + M_h^-1 (h f + J^T Lambda)
    v+  = v~+ - (h / 2) M^-1 c((v~+ + v+) / 2)

(G. Strang, *On the construction and comparison of difference schemes*, SIAM J. Numer. Anal. 5, 1968.) The law
is asked for a jump from ``v~- + (v~+ - v+)`` to v+, in which contact does the same work as from v~- to v~+.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.stepping.compiled.libmujoco import add_tendon_bias
from impactlaw.stepping.compiled.whitening import solve_inertia
from impactlaw.stepping.plan import has_constant_inertia

ROUNDS = 6
"""Fixed point iterations at most, for bodies that turn fast."""

SETTLED = 1e-2  # part of the velocity by which a round may change it and be the last one
STILL = 1e-9  # m/s or rad/s by which it may anyway

FAST = 0.5
"""Angle in a timestep, rad, of an angular velocity above which energy is watched."""

HALF_ROUNDS = 12
"""The same for the forces of half a step, of which the energy of a collision depends."""

HALF_SETTLED = 1e-10  # part of these forces

SMALL_PART = 1e-2
"""Part of the energy of a collision below which that of these forces is left: then others push bodies apart."""
_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_ROUND = 1e-9  # relative difference of moments of inertia that is rounding

INERTIA = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat", "tendon_armature")
"""Fields of mjModel that may make such forces act where there were none."""


class InertialForces:
    """The forces of one scene, ``M_h (v_free - v) = h (f - c(q_M, (v + v_free) / 2))``.

    Attributes:
        act: whether there are any, as `look` has seen it last.
        used: those of the last `settle`, with gravity, (nv,).
        turning: trees of bodies that turn too fast for the timestep, or nearly so, bool (ntree,); where no mean
            velocity was found, the last step did without these forces.
        gravity: at the middle of the step, (nv,), if there are such trees.
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
        """A copy looks at the arrays of its own model."""
        return InertialForces, (self._model,)

    def look(self) -> bool:
        """Return whether there are any, from now on; looks anew where a mass was changed and there were none.

        There are where the mass matrix depends on the configuration, or what turns freely has moments of inertia that
        differ.
        """
        if not self.act:
            seen = [field.tobytes() for field in self._looked]
            if seen != self._seen:
                self._seen = seen
                self.act = not has_constant_inertia(self._model) or _is_uneven(self._model)
        return self.act

    def settle(
        self,
        data: mujoco.MjData,
        start: np.ndarray,
        held: np.ndarray,
        metric: tuple[np.ndarray, np.ndarray],
        h: float,
    ) -> np.ndarray:
        """Return where forces lead without contact, (nv,)."""
        free, loose = data.qvel.copy(), np.ones(self._model.ntree, dtype=bool)
        self.turning = h * self._largest(np.where(self._rotates, start, 0.0)) > FAST
        for _ in range(ROUNDS):
            before, self.used = free, self.at(data, 0.5 * (start + free + held))
            free = self.lead_to(data, start, self.used, metric, h)
            loose = self._largest(free - before) > SETTLED * self._largest(free) + STILL
            if not np.count_nonzero(loose):
                break
        self._watch(data, loose)
        if np.count_nonzero(loose):
            self.used = np.where(loose[self._model.dof_treeid], self.gravity, self.used)
            free = self.lead_to(data, start, self.used, metric, h)
        return free

    def _largest(self, vector: np.ndarray) -> np.ndarray:
        """Return the largest size in each tree of bodies, (ntree,)."""
        largest = np.zeros(self._model.ntree)
        with np.errstate(invalid="ignore"):  # what is not finite is found at the end of the step
            np.maximum.at(largest, self._model.dof_treeid, np.abs(vector))
        return largest

    def _watch(self, data: mujoco.MjData, loose: np.ndarray) -> None:
        """Let further trees be some that turn too fast."""
        self.turning = self.turning | loose
        if np.count_nonzero(self.turning):
            self.gravity = self.at(data, np.zeros(self._model.nv))

    def at(self, data: mujoco.MjData, velocity: np.ndarray) -> np.ndarray:
        """Return those at a velocity, with gravity, (nv,) each."""
        kept, bias = data.qvel.copy(), np.empty(self._model.nv)
        data.qvel[:] = velocity
        mujoco.mj_comVel(self._model, data)
        mujoco.mj_rne(self._model, data, 0, bias)
        if self._model.ntendon:
            add_tendon_bias(self._model, data, bias)
        data.qvel[:] = kept
        return bias

    def half(
        self,
        data: mujoco.MjData,
        velocity: np.ndarray,
        gravity: np.ndarray,
        metric: tuple[np.ndarray, np.ndarray],
        h: float,
    ) -> tuple[np.ndarray, bool]:
        """Return those of half a step that ends at a velocity, or with h < 0 begins there, without gravity, (nv,).

        And whether they are settled.
        """
        before = force = self.at(data, velocity) - gravity
        for _ in range(HALF_ROUNDS):
            before, force = force, self.at(data, self.kick(velocity, force, metric, 0.25 * h)) - gravity
            if np.abs(force - before).max() <= HALF_SETTLED * np.abs(force).max():
                return force, True
        self._watch(data, self._largest(force - before) > HALF_SETTLED * np.abs(force).max())
        return force, False

    def lead_to(
        self, data: mujoco.MjData, start: np.ndarray, bias: np.ndarray, metric: tuple[np.ndarray, np.ndarray], h: float
    ) -> np.ndarray:
        """Return where forces lead without contact, (nv,), these being a bias, with gravity, (nv,); see `settle`."""
        return self.kick(start, data.qfrc_smooth + data.qfrc_bias - bias, metric, h)

    def kick(
        self, velocity: np.ndarray, force: np.ndarray, metric: tuple[np.ndarray, np.ndarray], h: float
    ) -> np.ndarray:
        """Return the velocity to which a force leads in a time h, (nv,)."""
        return velocity + h * self._accelerate(force, metric)

    def created(self, data: mujoco.MjData, start: np.ndarray, h: float) -> float:
        """Return the kinetic energy beside that of other forces in a step from a velocity to that of data, J.

        It is of first order in h, and of those of the last `settle`.
        """
        after = data.qvel
        own = after @ self.at(data, after) + start @ data.qfrc_bias
        return 0.5 * h * float(own - (start + after) @ self.used)

    def _accelerate(self, force: np.ndarray, metric: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        model = self._model
        return solve_inertia(force, metric[0], model.M_rownnz, model.M_rowadr, model.M_colind, metric[1])


def _is_uneven(model: mujoco.MjModel) -> bool:
    """Return whether moments of inertia differ of what a free joint carries, all bodies that are fixed to it."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    inertia = data.crb[model.jnt_bodyid[model.jnt_type == _FREE], :6]  # xx yy zz xy xz yz
    differ = np.maximum(np.ptp(inertia[:, :3], axis=1), np.abs(inertia[:, 3:]).max(axis=1))
    return bool((differ > _ROUND * inertia[:, :3].max(axis=1)).any())
