"""Describe how a recorded environment was made: the properties that a replay must share."""

from __future__ import annotations

import hashlib
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np

from impactlaw.envs.law_options import LawOptions

_DESCRIBED = {
    "parameters of the model": (
        "body_mass body_inertia body_pos body_quat geom_size geom_pos geom_friction geom_solref jnt_range "
        "jnt_stiffness dof_damping dof_armature dof_frictionloss actuator_gear actuator_gainprm actuator_biasprm "
        "numeric_data opt.gravity"
    ),
    "contact, air and ground of the model": (
        "geom_solimp geom_margin geom_condim jnt_solref jnt_solimp dof_solref dof_solimp pair_friction pair_solref "
        "pair_solimp eq_data eq_solref eq_solimp geom_surfacevel geom_fluid hfield_size hfield_data opt.wind "
        "opt.density opt.viscosity opt.magnetic opt.cone opt.impratio opt.disableflags opt.solver opt.iterations "
        "opt.tolerance"
    ),
    "centres of mass, axes, ranges and tendons of the model": (
        "body_ipos body_iquat body_gravcomp body_invweight0 geom_quat geom_contype geom_conaffinity geom_priority "
        "geom_solmix geom_gap geom_adhesion jnt_pos jnt_axis jnt_limited jnt_margin jnt_actfrclimited jnt_actfrcrange "
        "jnt_stiffnesspoly qpos_spring dof_dampingpoly dof_invweight0 actuator_ctrllimited actuator_ctrlrange "
        "actuator_forcelimited actuator_forcerange actuator_dynprm actuator_damping actuator_armature tendon_range "
        "tendon_stiffness tendon_damping tendon_frictionloss tendon_armature tendon_lengthspring tendon_limited "
        "eq_active0 opt.enableflags"
    ),
}
"""Fields of a model that environments set or randomize, by the name of their common digest."""


def how_made(options: LawOptions, model: mujoco.MjModel, timesteps: int | None) -> dict[str, Any]:
    """Return a description of how an environment steps, as plain values.

    Args:
        options: options in force.
        model: the model that is stepped.
        timesteps: timesteps per environment step; None if unknown.
    """
    rigid, contacts, speed = options.contact_model == "rigid", options.contacts, options.rest_speed
    return {
        "frame_skip": None if timesteps is None else int(timesteps),
        "timestep": float(model.opt.timestep),
        "integrator": mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_"),
        "contact_model": options.contact_model,
        "scheme": options.scheme_in_force,
        "friction": options.friction or "coulomb",
        "overlap": options.overlap if rigid else None,
        "rest_speed": None if speed is None else float(speed),
        "on_inadmissible": options.on_inadmissible,
        "contacts": [contacts] if isinstance(contacts, str) else None if contacts is None else sorted(contacts),
        "limits": bool(options.limits),
        "impulse_in_cfrc_ext": options.impulse_in_cfrc_ext,
    } | {name: _digest(model, fields) for name, fields in _DESCRIBED.items()}


def _digest(model: mujoco.MjModel, fields: str) -> str:
    """Return a short hash of fields of a model, rounded to single precision."""
    parts = [np.ravel(attrgetter(name)(model)) for name in fields.split()]
    return hashlib.sha256(np.concatenate(parts).astype(np.float32).tobytes()).hexdigest()[:12]
