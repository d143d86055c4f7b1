"""Contacts that other forces press closed: what these close in the course of some steps is no collision.

A force that accelerates a contact by a closes it by ``h a`` in a timestep. For light links, such as fingers that
muscles pull into their limits, this is far above ``rest_speed``. If such a contact collided anew in each step, its
spring, which is to balance the force, could not sink in, and each step would cost a collision. Therefore a contact
collides only when it has just closed. One that is deeper than it can have closed within a step was closed before: the
law has had its turn, and MuJoCo's contact acts alone, as in `mj_step`. It takes part in collisions of other contacts,
and collides itself if their impulses make it close by `rest_speed` more.

A velocity that is written into data, or that of a surface that starts to move, is no work of forces: a contact of any
depth collides if its acceleration in the last step is too small to give it its speed on a way as long as it is deep.

The foot of a leg that turns fast closes faster before than it does at the end of a step, without any acceleration of
its joints. Whether a contact of geoms that seems to be deeper was closed before is therefore looked up: where the
velocity has come from, ``q - h v``, or in the contacts at the start of a step of RK4 at whose end contacts collide.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.stepping.integration import STEP_STATE

_BEFORE = 1.1  # depth of a contact that was closed before the last step, relative to its largest way in that step


def approach_speed(gamma: float, acceleration: float, depth: float, timestep: float, rest_speed: float) -> float:
    """Return the closing speed above which a contact collides, m/s or rad/s; also called by compiled code.

    Args:
        gamma: its contact velocity, m/s or rad/s.
        acceleration: that of the contact in the step before, m/s^2 or rad/s^2; 0 if there was none.
        depth: how deep it is closed, m or rad.
        timestep: s.
        rest_speed: closing speed above which a contact collides that has just closed, m/s or rad/s.
    """
    closing = max(-gamma, timestep * acceleration - gamma)
    struck = 2.0 * depth * abs(acceleration) < gamma * gamma
    if gamma >= -rest_speed or struck or depth <= _BEFORE * timestep * closing:
        return rest_speed
    return rest_speed - gamma


def pairs_before(model: mujoco.MjModel, data: mujoco.MjData, other: mujoco.MjData) -> np.ndarray:
    """Return the geoms of the contacts at ``q - h v``, int32 (n, 2); other data is changed."""
    state = np.empty(mujoco.mj_stateSize(model, STEP_STATE))
    mujoco.mj_getState(model, data, state, STEP_STATE)
    mujoco.mj_setState(model, other, state, STEP_STATE)
    mujoco.mj_integratePos(model, other.qpos, data.qvel, -model.opt.timestep)
    mujoco.mj_kinematics(model, other)
    mujoco.mj_collision(model, other)
    return other.contact.geom
