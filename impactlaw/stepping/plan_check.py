"""Detect changes of the model that need a part that the plan has left out: the next step then raises an error.

Event-driven steps read friction when a contact is first seen; `PlanCheck.check` tells when they must read it again.
"""

from __future__ import annotations

from typing import Any, Literal

import mujoco
import numpy as np

from impactlaw.errors import SceneError
from impactlaw.stepping.compatibility import check_scene_friction
from impactlaw.stepping.plan import Plan, make_plan

_FRICTION = ("geom_friction", "geom_condim", "geom_priority", "pair_friction", "pair_dim")
_COEFFICIENTS = ("geom_friction", "geom_priority", "pair_friction")  # used where a condim is larger than 1
_CONTACT = ("geom_contype", "geom_conaffinity")
_LIMITED = ("jnt_limited", "tendon_limited")
_FILTER_PARENT = int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
_WORDS = {
    "detection": "geoms can meet",
    "friction": "contacts have friction",
    "limits": "joints or tendons have limits",
    "surfaces": "surfaces move",
}
"""What is true of a scene that needs a part of the plan, for error messages."""


def watched_fields(plan: Plan, friction: Literal["coulomb", "convex", "ignore"]) -> tuple[str, ...]:
    """Return the fields of the model whose change may require a part that the plan has left out.

    Soft steps and time stepping handle limits whatever the plan says, and time stepping also handles belts.
    """
    if not plan.detection:
        fields = _CONTACT
    elif friction != "ignore" and (not plan.friction or plan.scheme == "event-driven"):
        fields = _FRICTION + (() if plan.friction else _CONTACT)  # other geoms that can then meet may have friction
    else:
        fields = ()
    if plan.scheme == "time-stepping":
        return fields
    fields += ("geom_surfacevel",) if plan.friction and not plan.surfaces else ()
    if plan.contact_model == "soft":
        return fields
    return fields + _LIMITED + (("jnt_range",) if plan.limits else ())


class PlanCheck:
    """Checks whether the plan still fits the model, in the fields that steps depend on."""

    def __init__(self, model: mujoco.MjModel, plan: Plan, friction: Literal["coulomb", "convex", "ignore"]):
        self._model, self._plan = model, plan
        self._friction: Literal["coulomb", "convex", "ignore"] = friction
        self._names = tuple(name for name in watched_fields(plan, friction) if getattr(model, name).size)
        self._limits = _active_limits(model)
        self._keep()

    def __getstate__(self) -> dict[str, Any]:
        """Return everything but the arrays of the model that are read."""
        return self.__dict__ | {"_kept": [(name, kept) for name, _, kept in self._kept]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Read the arrays of the copied model."""
        self.__dict__.update(state)
        self._kept = [(name, getattr(self._model, name).tobytes, kept) for name, kept in state["_kept"]]

    def __bool__(self) -> bool:
        """Whether there is any field to check."""
        return len(self._names) > 0

    def check(self) -> bool:
        """Refuse changes of the model that need a part that was left out; return whether friction was changed.

        Raises:
            SceneError: the model now needs a part that was left out, limits of joints have changed (event-driven), or
                friction cannot be resolved. The message says what has changed.
        """
        rubs = False
        if not self._plan.detection and self._parents != self._model.opt.disableflags & _FILTER_PARENT:
            self._compare("opt.disableflags")
            self._keep()
        for name, read, kept in self._kept:
            if read() != kept:
                self._compare(name)
                self._keep()
                rubs = rubs or name in _FRICTION
        return rubs

    def _keep(self) -> None:
        self._parents = self._model.opt.disableflags & _FILTER_PARENT
        model = self._model
        rubs = (model.geom_condim > 1).any() or (model.pair_dim > 1).any()
        names = (name for name in self._names if rubs or name not in _COEFFICIENTS)
        self._kept = [(name, read, read()) for name in names for read in [getattr(model, name).tobytes]]

    def _compare(self, name: str) -> None:
        """Check everything that a change of this field may affect."""
        model, old = self._model, self._plan
        new = make_plan(model, old.contact_model, scheme=old.scheme, friction=self._friction)
        for part, words in _WORDS.items():
            if getattr(new, part) and not getattr(old, part):
                raise SceneError(
                    f"{words} since model.{name} was changed, but none did when the stepper was made, and it has left "
                    "that out; make a new Stepper, or, of an environment, a new environment"
                )
        if name in _FRICTION:
            check_scene_friction(model, new)
        if old.scheme == "event-driven" and _active_limits(model) != self._limits:
            raise SceneError(
                f"model.{name} was changed, but event-driven steps keep the limits that joints and tendons had when "
                'the stepper was made; make a new Stepper or environment, or use scheme="time-stepping"'
            )


def _active_limits(model: mujoco.MjModel) -> bytes:
    """Return a fingerprint of the limits of joints and tendons."""
    joints = np.where(model.jnt_limited[:, None] != 0, model.jnt_range, 0.0)
    return model.jnt_limited.tobytes() + model.tendon_limited.tobytes() + joints.tobytes()
