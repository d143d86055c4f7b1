"""Time stepping without event location, after Moreau and Jean, to compare located impacts with.

One step of duration h from (q, v):

    q_m = q + h/2 v,   M, f, contacts and J at q_m;   closed: gap <= tolerance
    v_free = v + h M^-1 f(q_m, v)
    0 <= Lambda  ⊥  J v+ - gamma^h >= 0,   v+ = v_free + M^-1 J^T Lambda
    q+ = q_m + h/2 v+

gamma^h is the law's target at ``gamma- = J v`` for the closed contacts with ``gamma- <= 0`` (laws are maps from -T_C)
and zero for those that separate.

A contact is met up to one step late and stays as deep as it was met, so that the order is one.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw import Collision, Law
from impactlaw.contacts import GAP_TOLERANCE, Contacts, kinetic_metric, update_positions
from impactlaw.detection import Detector
from impactlaw.solvers import Problem, solve_with_jump

_ROUNDING = 1e-12  # of a contact velocity in the kinetic metric, relative to the velocity of the scene
_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


class TimeStepping:
    """Moreau's midpoint rule with a law, on a scene of slides and hinges.

    Args:
        model: the scene; its timestep is read at every step, its integrator is not used.
        law: the law.
    """

    def __init__(self, model: mujoco.MjModel, law: Law):
        self._model = model
        self._law = law
        self._detector = Detector(model)

    def step(self, data: mujoco.MjData) -> None:
        """Advance by one timestep."""
        model, h = self._model, self._model.opt.timestep
        v = data.qvel.copy()
        mujoco.mj_integratePos(model, data.qpos, v, 0.5 * h)
        free = v + h * self._acceleration(data)
        update_positions(model, data)
        near = self._detector.near(data, GAP_TOLERANCE)
        contacts, gradients = near.contacts, near.jacobian
        data.qvel[:] = self._constrain(data, contacts, gradients, v, free) if len(contacts) else free
        mujoco.mj_integratePos(model, data.qpos, data.qvel, 0.5 * h)
        data.time += h

    def _acceleration(self, data: mujoco.MjData) -> np.ndarray:
        opt = self._model.opt
        kept = opt.disableflags
        opt.disableflags |= _NO_CONTACT
        try:
            mujoco.mj_forward(self._model, data)
        finally:
            opt.disableflags = kept
        return data.qacc.copy()

    def _constrain(
        self, data: mujoco.MjData, contacts: Contacts, J: np.ndarray, v: np.ndarray, free: np.ndarray
    ) -> np.ndarray:
        metric = kinetic_metric(self._model, data)
        Y = metric.whiten_gradients(J)
        wanted = np.zeros(len(contacts))
        closing = np.flatnonzero(J @ v <= _ROUNDING * metric.norm(v) * np.linalg.norm(Y, axis=1))
        if len(closing):
            labels = contacts.select(closing).labels
            collision = Collision(metric.mass_matrix, J[closing], v, labels=labels, metric=metric)
            wanted[closing] = self._law.target(collision).contact_velocity
        problem = Problem(Y, wanted - J @ free, speed=metric.norm(free))
        return free + metric.unwhiten(solve_with_jump(problem, contacts.labels).jump)
