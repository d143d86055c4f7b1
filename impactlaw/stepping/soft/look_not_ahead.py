"""RK4 of soft steps that end in a collision: its stages are not to feel a contact before it is there."""

from __future__ import annotations

import mujoco

NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
"""Flags with which neither contacts nor limits act."""


def look_not_ahead(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Do what RK4 does after `mj_forward`, but let no contact act that does not at the start.

    Its stages would take up to half of the speed that the law is to reverse. Where nothing touches at the start, no
    contact acts in them. Else this is Euler, whose forces are those of the start; so it is with a control callback,
    which RK4 would call again.
    """
    if data.ncon or data.nl or mujoco.get_mjcb_control() is not None:
        mujoco.mj_Euler(model, data)
        return
    options = model.opt
    flags = options.disableflags
    options.disableflags = flags | NO_CONTACT
    try:
        mujoco.mj_RungeKutta(model, data, 4)
    finally:
        options.disableflags = flags
