"""Coriolis and gyroscopic forces at the mean velocity of a step, in which they do no work.

MuJoCo's integrators evaluate them at the velocity of the start, which makes energy of first order in the timestep.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.stepping.compiled.whitening import solve_inertia
from impactlaw.stepping.plan import has_constant_inertia

ROUNDS = 6
"""Fixed point iterations at most, for bodies that turn fast."""

SETTLED = 1e-2  # part of the velocity by which a round may change it and be the last one
_TURNING = [int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)]
_ROUND = 1e-9  # relative difference of moments of inertia that is rounding


class InertialForces:
    """The forces of one scene, ``M_h (v_free - v) = h (f - c(q_M, (v + v_free) / 2))``.

    Args:
        model: the scene.

    Attributes:
        act: whether there are any: the mass matrix depends on the configuration, or a body turns whose moments of
            inertia differ.
    """

    def __init__(self, model: mujoco.MjModel):
        inertia = model.body_inertia[model.jnt_bodyid[np.isin(model.jnt_type, _TURNING)]]
        uneven = len(inertia) > 0 and bool((np.ptp(inertia, axis=1) > _ROUND * inertia.max(axis=1)).any())
        self.act = uneven or not has_constant_inertia(model)
        self._model = model
        self._bias = np.zeros(model.nv)

    def settle(
        self, data: mujoco.MjData, start: np.ndarray, metric: tuple[np.ndarray, np.ndarray], h: float
    ) -> np.ndarray:
        """Return where forces lead without contact, (nv,).

        Args:
            data: in the middle of the step; qvel is where they lead with these forces as at the start.
            start: velocity at the start, (nv,).
            metric: L and 1 / D of the mass matrix of the step.
            h: timestep, s.
        """
        free = data.qvel.copy()
        for _ in range(ROUNDS):
            before, free = free, self.lead_to(data, start, 0.5 * (start + free), metric, h)
            if np.abs(free - before).max() <= SETTLED * np.abs(free).max():
                return free
        free = start + h * self._accelerate(data.qfrc_smooth, metric)  # they turn too fast for the timestep:
        return free * min(1.0, np.sqrt(self._allowed(data, start, free, h)))  # at least no energy comes of it

    def lead_to(
        self,
        data: mujoco.MjData,
        start: np.ndarray,
        mean: np.ndarray,
        metric: tuple[np.ndarray, np.ndarray],
        h: float,
    ) -> np.ndarray:
        """Return where forces lead without contact if these are those of a mean velocity, (nv,); see `settle`."""
        kept = data.qvel.copy()
        data.qvel[:] = mean
        mujoco.mj_comVel(self._model, data)
        mujoco.mj_rne(self._model, data, 0, self._bias)
        data.qvel[:] = kept
        return start + h * self._accelerate(data.qfrc_smooth + data.qfrc_bias - self._bias, metric)

    def work(self, start: np.ndarray, after: np.ndarray, h: float) -> float:
        """Return the work that those of the last `lead_to` do from one velocity to another, (nv,) each, J."""
        return -0.5 * h * float(self._bias @ (start + after))

    def _accelerate(self, force: np.ndarray, metric: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        model = self._model
        return solve_inertia(force, metric[0], model.M_rownnz, model.M_rowadr, model.M_colind, metric[1])

    def _allowed(self, data: mujoco.MjData, start: np.ndarray, free: np.ndarray, h: float) -> float:
        """Return ``v^T M v`` of the start, with twice the work of other forces, relative to ``v^T M v`` of the end."""
        momentum = np.empty(self._model.nv)
        mujoco.mj_mulM(self._model, data, momentum, free)
        after = float(momentum @ free)
        mujoco.mj_mulM(self._model, data, momentum, start)
        work = h * float((data.qfrc_smooth + data.qfrc_bias) @ (start + free))
        return (float(momentum @ start) + max(0.0, work)) / after if after > 0.0 else 1.0
