"""Make the time stepping of a scene."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

import mujoco

from impactlaw.compiled import compile_together
from impactlaw.laws import Law
from impactlaw.stepping.plan import Plan

if TYPE_CHECKING:
    from impactlaw.stepping.time_stepping.scheme import TimeStepping


_ENTRY = "impactlaw.stepping.time_stepping.compiled.entry"
"""The module that calls all compiled functions."""


def compile_steps() -> None:
    """Compile steps, once on every machine; later processes load them from numba's cache on disk."""
    compile_together(_ENTRY)
    import_module(_ENTRY)


def make_time_stepping(
    model: mujoco.MjModel, law: Law, plan: Plan, *, compiled: Literal["auto", "never"] | None = None, **options: Any
) -> TimeStepping:
    """Return the time stepping of a scene.

    Args:
        model: the scene.
        law: the law.
        plan: the plan of the scene.
        compiled: "auto" to warn if the law is asked in Python; "never" to ask any law there, and to keep collisions.
        options: options of `law_in_scene.LawInScene`.

    Raises:
        UncompilableError: numba cannot be imported, or MuJoCo keeps its data elsewhere than it says.
    """
    compile_steps()
    from impactlaw.stepping.time_stepping.law_in_scene import LawInScene
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

    scene = LawInScene(model, law, plan, in_python=compiled == "never", **options)
    return TimeStepping(scene, warn=compiled == "auto")
