"""Measures of a state, whichever way to step led to it: depth, violation of limits, energy. None of this is timed."""

import copy
from typing import NamedTuple

import mujoco
import numpy as np

_LIMITS = [int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT), int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)]
_SINGLE, _OVERRIDE = int(mujoco.mjtDisableBit.mjDSBL_MULTICCD), int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_STAGES = (
    *(mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_collision, mujoco.mj_makeConstraint),
    *(mujoco.mj_makeM, mujoco.mj_energyPos, mujoco.mj_energyVel),
)
"""The stages that find contacts, limits and energies; other ones of `mj_forward` fail where contacts fill the arena."""


class Seen(NamedTuple):
    """Measures of one state.

    Attributes:
        depth: depth of the deepest contact between geoms, m; 0 without contact.
        pair: names of the geoms of that contact.
        limit: largest violation of a joint's or tendon's limit, m or rad.
        energy: sum of potential and kinetic energy, J.
    """

    depth: float
    pair: str
    limit: float
    energy: float


class Watch:
    """Evaluates states of a scene with its own data and options: margins 0, exact convex collisions.

    Args:
        model: the scene.
        tolerance: of the detection of convex shapes, m.

    Attributes:
        data: the data of the state that was seen last.
        passive: whether no part of the scene feeds energy: no actuators, mocap bodies, belts or gravity compensation.
    """

    def __init__(self, model: mujoco.MjModel, tolerance: float = 1e-10):
        self._model = own = copy.copy(model)
        own.geom_margin[:] = own.geom_gap[:] = own.pair_margin[:] = own.pair_gap[:] = 0.0
        own.jnt_margin[:] = own.tendon_margin[:] = 0.0
        own.opt.disableflags |= _SINGLE
        own.opt.enableflags &= ~(_OVERRIDE | _SLEEP)
        own.opt.ccd_tolerance = min(own.opt.ccd_tolerance, tolerance)
        own.opt.ccd_iterations = max(own.opt.ccd_iterations, 100)
        self.data = mujoco.MjData(own)
        fed = model.nu or model.nmocap or model.geom_surfacevel.any() or model.body_gravcomp.any()
        self.passive = not fed

    def look(self, data: mujoco.MjData, qpos: np.ndarray, qvel: np.ndarray) -> Seen:
        """Return the measures of a position and velocity; mocap poses and active constraints come from data."""
        own, model = self.data, self._model
        own.mocap_pos[:], own.mocap_quat[:], own.eq_active[:] = data.mocap_pos, data.mocap_quat, data.eq_active
        own.qpos[:], own.qvel[:] = qpos, qvel
        for stage in _STAGES:
            stage(model, own)
        between = (own.contact.geom >= 0).all(axis=1)
        dist = np.where(between, own.contact.dist, 0.0)
        worst = int(np.argmin(dist)) if len(dist) else -1
        deep = worst >= 0 and dist[worst] < 0.0
        of_limits = own.efc_pos[np.isin(own.efc_type, _LIMITS)]
        pair = "/".join(_name(model, int(g)) for g in own.contact.geom[worst]) if deep else ""
        depth, limit = -float(dist[worst]) if deep else 0.0, 0.0 - float(of_limits.min(initial=0.0))
        return Seen(depth, pair, limit, float(own.energy.sum()))


def _name(model: mujoco.MjModel, geom: int) -> str:
    return model.geom(geom).name or f"{model.body(int(model.geom_bodyid[geom])).name or 'world'}:{geom}"
