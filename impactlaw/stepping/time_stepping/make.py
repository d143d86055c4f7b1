"""Which time stepping a scene and a law have: in compiled code, or in Python."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Literal

import mujoco

from impactlaw.errors import UncompiledWarning
from impactlaw.laws import Law
from impactlaw.stepping.plan import Plan

if TYPE_CHECKING:
    from impactlaw.stepping.time_stepping.compiled.stepping import CompiledStepping
    from impactlaw.stepping.time_stepping.scheme import TimeStepping


def make_time_stepping(
    model: mujoco.MjModel,
    law: Law,
    plan: Plan,
    *,
    compiled: Literal["auto", "never"] | None,
    **options: Any,
) -> TimeStepping | CompiledStepping:
    """Return the time stepping of a scene.

    Args:
        model: the scene.
        law: the law.
        plan: of the scene.
        compiled: None for compiled code where it can be had, "auto" to warn where not, "never" for Python.
        options: of `scheme.TimeStepping`.
    """
    from impactlaw.stepping.time_stepping.warm_up import warm_up

    warm_up()
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

    scheme = TimeStepping(model, law, plan, **options)
    if compiled == "never":
        return scheme
    from impactlaw.stepping.compiled.layout import LayoutError
    from impactlaw.stepping.time_stepping.compiled.stepping import CompiledStepping

    try:
        return CompiledStepping(scheme, warn=compiled == "auto")
    except LayoutError as error:
        if compiled == "auto":
            warnings.warn(f"steps are not compiled, but in Python: {error}", UncompiledWarning, stacklevel=3)
        return scheme
