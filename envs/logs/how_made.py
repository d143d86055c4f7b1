"""How an environment that is recorded was made: what a replay needs to be the same."""

from __future__ import annotations

import hashlib
from typing import Any

import mujoco
import numpy as np

from impactlaw.envs.law_options import LawOptions

_PARAMETERS = (
    "body_mass", "body_inertia", "body_pos", "body_quat", "geom_size", "geom_pos", "geom_friction", "geom_solref",
    "jnt_range", "jnt_stiffness", "dof_damping", "dof_armature", "dof_frictionloss", "actuator_gear",
    "actuator_gainprm", "actuator_biasprm", "numeric_data",
)  # fmt: skip
"""Fields of a model that environments are made, or randomized, with."""


def how_made(options: LawOptions, model: mujoco.MjModel, timesteps: int | None) -> dict[str, Any]:
    """Return how an environment steps, as plain values.

    Args:
        options: in force.
        model: that is stepped.
        timesteps: per environment step; None if that is not known.
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
        "parameters of the model": _digest(model),
    }


def _digest(model: mujoco.MjModel) -> str:
    """Return a short text that differs where masses, sizes, friction, gravity or the like do, beyond rounding."""
    parts = [np.ravel(getattr(model, name)) for name in _PARAMETERS] + [model.opt.gravity]
    return hashlib.sha256(np.concatenate(parts).astype(np.float32).tobytes()).hexdigest()[:12]
