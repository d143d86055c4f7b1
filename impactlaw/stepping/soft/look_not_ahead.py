"""RK4 of soft steps that end in a collision: its stages are not to feel a contact before it is there."""

from __future__ import annotations

import mujoco
import numpy as np

SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
"""Flag with which trees can sleep."""
_READ = "qacc", "act_dot", "M", "qfrc_smooth", "qfrc_constraint"  # RK4 reads the first two
NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
"""Flags with which neither contacts nor limits act."""


def keep_start(data: mujoco.MjData, *, touches: bool) -> tuple[np.ndarray, ...]:
    """Return what `look_not_ahead` reads of what `mj_forward` has found, besides the state."""
    if touches or mujoco.get_mjcb_control() is not None:
        return tuple(getattr(data, name).copy() for name in _READ)
    return data.qacc.copy(), data.act_dot.copy()


def put_start(data: mujoco.MjData, start: tuple[np.ndarray, ...]) -> None:
    """Let `look_not_ahead` go on from there; only if `is_plain`."""
    for name, value in zip(_READ, start, strict=False):
        getattr(data, name)[:] = value


def is_plain(model: mujoco.MjModel) -> bool:
    """Return whether integrators read no more than that: no sensors with a history, no plugins, no trees that sleep."""
    return not (model.nhistory or model.nplugin or model.opt.enableflags & SLEEP)


def look_not_ahead(model: mujoco.MjModel, data: mujoco.MjData, *, touches: bool) -> None:
    """Do what RK4 does after `mj_forward`, but let no contact act that does not at the start.

    Its stages would take up to half of the speed that the law is to reverse. Where nothing touches at the start, no
    contact acts in them. Else this is Euler, whose forces are those of the start; so it is with a control callback,
    which RK4 would call again.

    Args:
        model: the scene.
        data: after `mj_forward`.
        touches: whether something touches.
    """
    if touches or mujoco.get_mjcb_control() is not None:
        mujoco.mj_Euler(model, data)
        return
    options = model.opt
    flags = options.disableflags
    options.disableflags = flags | NO_CONTACT
    try:
        mujoco.mj_RungeKutta(model, data, 4)
    finally:
        options.disableflags = flags
