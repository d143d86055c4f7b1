"""Start and controls of a case."""

import copy
from typing import Literal

import mujoco
import numpy as np

from .scenes import Loaded

Start = Literal["drop", "random"]
HELD = 20
"""Number of steps for which random controls are held."""
_FREE, _SLIDE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "SLIDE"))
_LEVEL = 0.9  # vertical component of a slide's axis above which it lifts a base


def start(loaded: Loaded, raised: float) -> mujoco.MjData:
    """Return the state to start from.

    It is the keyframe "home", else the state after a reset of the environment, else the first keyframe, else qpos0.
    Floating bases, of robots and of objects, are raised.
    """
    model = loaded.model
    names = [model.key(i).name for i in range(model.nkey)]
    if loaded.data is not None and "home" not in names:
        data = copy.copy(loaded.data)
    else:
        data = mujoco.MjData(model)
        if names:
            mujoco.mj_resetDataKeyframe(model, data, names.index("home") if "home" in names else 0)
    data.time = 0.0
    for place in lifting(model):
        data.qpos[place] += raised
    return data


def lifting(model: mujoco.MjModel) -> list[int]:
    """Return the indices in qpos that lift a body off the ground: heights of free joints, and upright slides."""
    rooted, free = model.body_parentid[model.jnt_bodyid] == 0, model.jnt_type == _FREE
    upright = (model.jnt_type == _SLIDE) & (model.jnt_axis[:, 2] > _LEVEL) & (model.jnt_limited == 0)
    return (model.jnt_qposadr + 2 * free)[rooted & (free | upright)].tolist()


def controls(model: mujoco.MjModel, kind: Start, held: np.ndarray, blocks: int, seed: int) -> np.ndarray:
    """Return the controls of each block of `HELD` steps, (blocks, nu)."""
    if kind == "drop":
        return np.tile(held, (blocks, 1))
    limited = model.actuator_ctrllimited.astype(bool)
    low, high = np.where(limited, model.actuator_ctrlrange.T, np.array([[-1.0], [1.0]]))
    return np.random.default_rng(seed).uniform(low, high, (blocks, model.nu))
