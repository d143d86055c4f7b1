"""MuJoCo's own soft contacts on the same scene, for comparison: as they are, and tuned to a restitution."""

from __future__ import annotations

import copy
import math

import mujoco
import numpy as np
import scipy

from impactlaw.mechanics.friction_impact import FrictionImpact
from impactlaw.mechanics.impact import Impact
from impactlaw.scene.contacts import update_positions
from impactlaw.scene.detection import Detector
from impactlaw.stepping.integration import restore_state, save_state

_STEPS_IN_CONTACT = 10  # timesteps of one bounce of the tuned contact; with fewer the integrator decides the outcome
_LONGEST_CONTACT = 0.1  # s: a soft collision that has not ended after this time, or after the following
_LONGEST_STEPS = 4 * _STEPS_IN_CONTACT  # number of timesteps if that is longer, is audited as it is
_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # nearly one and constant, so that solref is a plain spring and damper


def tuned_contacts(model: mujoco.MjModel, restitution: float) -> mujoco.MjModel:
    """Return a copy of the model whose contacts and limits are springs and dampers tuned to a restitution.

    The coefficients of friction are those of the scene. But MuJoCo's friction uses the damping of the contact, so a
    restitution near 1 leaves little friction.

    MuJoCo's direct format ``solref = (-k, -b)`` makes a contact the oscillator ``r'' + b r' + k r = 0`` that pushes
    but does not pull, ``b = 2 zeta sqrt(k)``. It opens after the time ``t`` with the restitution ``e``:

        zeta = sin(beta):  e = exp(-(pi - 2 beta) tan(beta)),   t sqrt(k) = (pi - 2 beta) / cos(beta)
        zeta = cosh(s):    e = exp(-2 s / tanh(s)),             t sqrt(k) = 2 s / sinh(s)

    (the second line for e below exp(-2); e below 0.01 is replaced by 0.01). The stiffness k makes t ten timesteps.
    """
    zeta, time = _damping(max(restitution, 0.01))
    frequency = time / (_STEPS_IN_CONTACT * model.opt.timestep)
    tuned = copy.deepcopy(model)
    limits = (tuned.jnt_solref, tuned.tendon_solref_lim), (tuned.jnt_solimp, tuned.tendon_solimp_lim)
    for reference in (tuned.geom_solref, tuned.pair_solref, tuned.opt.o_solref, *limits[0]):
        reference[:] = -(frequency**2), -2.0 * zeta * frequency
    for impedance in (tuned.geom_solimp, tuned.pair_solimp, tuned.opt.o_solimp, *limits[1]):
        impedance[:] = _IMPEDANCE
    margins = tuned.geom_margin, tuned.geom_gap, tuned.pair_margin, tuned.pair_gap, tuned.jnt_margin
    for margin in (*margins, tuned.tendon_margin):
        margin[:] = 0.0
    tuned.opt.o_margin = 0.0  # used if the scene itself overrides contact parameters
    return tuned


def _damping(restitution: float) -> tuple[float, float]:
    """Return zeta, and the time in contact times the frequency of the undamped oscillator, ``t sqrt(k)``."""
    wanted = -math.log(restitution)
    if wanted < 2.0:
        beta = scipy.optimize.root_scalar(
            lambda b: (math.pi - 2 * b) * math.tan(b) - wanted, bracket=(0.0, math.pi / 2 - 1e-9)
        ).root
        return math.sin(beta), (math.pi - 2 * beta) / math.cos(beta)
    s = scipy.optimize.root_scalar(lambda s: 2 * s / math.tanh(s) - wanted, bracket=(1e-9, 10.0)).root
    return math.cosh(s), 2 * s / math.sinh(s)


def soft_outcome(model: mujoco.MjModel, data: mujoco.MjData, impact: Impact) -> Impact:
    """Simulate a collision that a law has resolved with MuJoCo's contacts, and audit the outcome.

    The collision starts at the configuration in data with the velocity before the impact. It ends with the first step
    after which none of its contacts overlaps, or after 0.1 s (40 timesteps if that is longer). The effect of other
    forces in the meantime (gravity, motors, other contacts) is part of the outcome.

    Args:
        model: the scene with the desired soft contacts.
        data: the configuration of the collision, controls and other forces; not changed.
        impact: the impact by the law.
    """
    scratch = mujoco.MjData(model)
    restore_state(model, scratch, save_state(model, data))
    scratch.qvel[:] = impact.collision.pre_velocity
    touched, detector, own = False, Detector(model), set(impact.collision.labels)
    for _ in range(max(_LONGEST_STEPS, math.ceil(_LONGEST_CONTACT / model.opt.timestep))):
        mujoco.mj_step(model, scratch)
        update_positions(model, scratch)
        near = detector.near(scratch, 0.0).contacts
        overlap = not own.isdisjoint(label for label, gap in zip(near.labels, near.gap, strict=True) if gap < 0)
        touched |= overlap
        if touched and not overlap:
            break
    audit = Impact.observed if impact.collision.friction is None else FrictionImpact.observed
    return audit(impact.collision, np.array(scratch.qvel))


def deepest_gap(model: mujoco.MjModel, data: mujoco.MjData, detector: Detector) -> float:
    """Return the smallest gap if geoms overlap now, else 0, m; frames and contacts of data are updated."""
    update_positions(model, data)
    contacts = detector.near(data, 0.0).contacts
    return float(contacts.gap[contacts.geoms[:, 0] >= 0].min(initial=0.0))
