"""The forces of contact on bodies over an environment step, in the convention of MuJoCo's ``cfrc_ext``."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.scene.contacts import Contacts
from impactlaw.scene.friction_rows import friction_on_contacts
from impactlaw.scratch import Scratch
from impactlaw.stepping.impact_event import ImpactEvent


class ContactForces:
    """An accumulator of the law's impulses over an environment step, which writes their mean force to ``cfrc_ext``.

    With soft contact, ``cfrc_ext`` is the result of `mj_rnePostConstraint` in the last timestep, as usual, plus the
    law's impulses in all timesteps divided by the duration of the environment step. With rigid contact, where all
    contact forces are the law's, it is the mean of the results of `mj_rnePostConstraint` over all timesteps.

    Args:
        model: the scene.
        rigid: whether contact is rigid.
    """

    def __init__(self, model: mujoco.MjModel, *, rigid: bool):
        self._model, self._rigid = model, rigid
        self._sum, self._steps = np.zeros((model.nbody, 6)), 0
        self._then = Scratch(model)

    def clear(self) -> None:
        """Clear the sums, at the start of an environment step."""
        self._sum[:], self._steps = 0.0, 0

    def add(self, data: mujoco.MjData, steps: int, events: Iterable[ImpactEvent]) -> None:
        """Add a number of timesteps and their collisions to the sums; if contact is rigid, one at a time."""
        self._steps += steps
        if self._rigid:
            mujoco.mj_rnePostConstraint(self._model, data)
            self._sum += data.cfrc_ext
            return
        for event in events:
            self._sum += self._impulses(data, event) / self._model.opt.timestep

    def write(self, data: mujoco.MjData) -> None:
        """Write ``cfrc_ext``, which must hold MuJoCo's own forces in the last timestep."""
        if not self._steps:
            return
        if self._rigid:
            data.cfrc_ext[:] = 0.0
        data.cfrc_ext[:] += self._sum / self._steps

    def _impulses(self, data: mujoco.MjData, event: ImpactEvent) -> np.ndarray:
        """Return the impulses on bodies in a collision, (nbody, 6), about the centers of mass at that time."""
        model, then, impact = self._model, self._then.data, event.impact
        then.qpos[:], then.mocap_pos[:], then.mocap_quat[:] = event.qpos, data.mocap_pos, data.mocap_quat
        mujoco.mj_kinematics(model, then)
        mujoco.mj_comPos(model, then)
        force, torque = impact.impulse[:, None] * event.contacts.normal, np.zeros((len(event.contacts), 3))
        if isinstance(impact, FrictionImpact) and (rows := impact.collision.friction) is not None:
            slide, torque = friction_on_contacts(
                model, then, event.contacts,
                contact=rows.contact, jacobian=rows.jacobian, impulse=impact.friction_impulse,
            )  # fmt: skip
            force = force + slide
        return on_bodies(model, then, event.contacts, force, torque)


def on_bodies(
    model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts, force: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """Return the wrenches of contacts on bodies, torque before force, (nbody, 6), in the convention of ``cfrc_ext``.

    Torques are about the center of mass of the body's kinematic tree (``subtree_com`` of its root), in world axes. The
    row of the world is zero. Joint limits are internal and contribute nothing.

    Args:
        model: the scene.
        data: data with current frames and centers of mass.
        contacts: the contacts.
        force: forces on their second bodies, world frame, (h, 3).
        torque: torques on their second bodies, world frame, (h, 3).
    """
    total = np.zeros((model.nbody, 6))
    bodies = np.append(model.geom_bodyid, 0)[contacts.geoms]  # -1 is the world
    for side, sign in ((0, -1.0), (1, 1.0)):
        arm = contacts.position - data.subtree_com[model.body_rootid[bodies[:, side]]]
        np.add.at(total, bodies[:, side], sign * np.hstack([torque + np.cross(arm, force), force]))
    total[0] = 0.0
    return total
