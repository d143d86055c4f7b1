"""MuJoCo's own soft contacts on the same scene, as the thing to compare with."""

from __future__ import annotations

import copy
import math

import mujoco
import numpy as np

from impactlaw.contacts import detect, geom_names, update_positions
from impactlaw.impact import Impact

_OVERRIDE = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
_STEPS_IN_CONTACT = 10  # timesteps one bounce of the tuned contact lasts; fewer and the integrator decides the outcome
_LONGEST_CONTACT = 0.1  # s after which a soft collision that has not come apart is audited as it is, if that is more
_LONGEST_STEPS = 4 * _STEPS_IN_CONTACT  # than so many timesteps
_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # nearly one and constant, so that solref is a plain spring and damper


def tuned_contacts(model: mujoco.MjModel, restitution: float) -> mujoco.MjModel:
    """Return a copy of the model whose contacts are springs and dampers tuned to a coefficient of restitution.

    MuJoCo's direct format ``solref = (-stiffness, -damping)`` makes a contact the oscillator
    ``r'' + b r' + k r = 0``, which bounces with ``e = exp(-pi zeta / sqrt(1 - zeta^2))``, ``b = 2 zeta sqrt(k)``. The
    stiffness k lets half a period last 10 timesteps.
    """
    if restitution > 0:
        zeta = -math.log(restitution) / math.hypot(math.pi, math.log(restitution))
    else:
        zeta = 1.0
    damped = math.pi / (_STEPS_IN_CONTACT * model.opt.timestep)
    stiffness = damped**2 / max(1.0 - zeta**2, 0.1)
    tuned = copy.deepcopy(model)
    tuned.opt.enableflags |= _OVERRIDE
    tuned.opt.o_margin = 0.0
    tuned.opt.o_solref[:] = -stiffness, -2.0 * zeta * math.sqrt(stiffness)
    tuned.opt.o_solimp[:] = _IMPEDANCE
    return tuned


def soft_outcome(model: mujoco.MjModel, data: mujoco.MjData, impact: Impact) -> Impact:
    """Let MuJoCo's contacts act on a collision that a law has resolved, and audit what comes out.

    The collision starts at data's configuration with the velocity before the impact, and has ended at the first step
    after which no contact overlaps, or after 0.1 s (40 timesteps if that is longer). Whatever else acts meanwhile (gravity) is part of the outcome.

    Args:
        model: the scene with the soft contacts wanted.
        data: the configuration of the collision; not changed.
        impact: the law's impact there.
    """
    scratch = mujoco.MjData(model)
    scratch.qpos[:] = data.qpos
    scratch.qvel[:] = impact.collision.pre_velocity
    touched = False
    for _ in range(max(_LONGEST_STEPS, math.ceil(_LONGEST_CONTACT / model.opt.timestep))):
        mujoco.mj_step(model, scratch)
        overlap = deepest_gap(model, scratch) < 0
        touched |= overlap
        if touched and not overlap:
            break
    return Impact.observed(impact.collision, np.array(scratch.qvel))


def deepest_gap(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the smallest gap of now where geoms overlap, else 0, m. Frames and contacts of data are renewed."""
    update_positions(model, data)
    return float(detect(model, data, 0.0, geom_names(model)).gap.min(initial=0.0))
