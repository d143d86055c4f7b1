"""Make the time stepping of a scene and a law, in compiled code or in Python."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import mujoco

from impactlaw.compiled import announce, compile_together
from impactlaw.errors import UncompilableError, warn_of_python
from impactlaw.laws import Law, Moreau
from impactlaw.solvers import load_solvers
from impactlaw.stepping.plan import Plan, make_plan

if TYPE_CHECKING:
    from impactlaw.stepping.time_stepping.compiled.stepping import CompiledStepping
    from impactlaw.stepping.time_stepping.scheme import TimeStepping


_SOLVER, _ENTRY = "impactlaw.solvers.cones.solve", "impactlaw.stepping.time_stepping.compiled.entry"
"""Modules that call all functions compiled for steps in Python, and for compiled steps."""
_SCENE = """<mujoco><option timestep="0.01"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .09"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""


@cache
def warm_up() -> None:
    """Compile what steps in Python need, once on every machine; later processes load it from numba's cache on disk.

    Two steps of a spinning box that overlaps a floor call all of it.
    """
    announce("impactlaw.stepping.time_stepping")
    compile_together(_SOLVER)
    from impactlaw.stepping.compiled.libmujoco import without_callbacks
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

    options: dict[str, Any] = {"friction": "coulomb", "on_inadmissible": "project", "rest_speed": None}
    with without_callbacks():
        model = mujoco.MjModel.from_xml_string(_SCENE)
        data, plan = mujoco.MjData(model), make_plan(model, scheme="time-stepping")
        data.qvel[:] = 0.0, 0.0, -1.0, 9.0, 9.0, 9.0
        stepping = TimeStepping(model, Moreau(0.5), plan, **options)
        stepping.step(data)
        stepping.step(data)


def make_time_stepping(
    model: mujoco.MjModel, law: Law, plan: Plan, *, compiled: Literal["auto", "never"] | None, **options: Any
) -> TimeStepping | CompiledStepping:
    """Return the time stepping of a scene.

    Args:
        model: the scene.
        law: the law.
        plan: the plan of the scene.
        compiled: None for compiled code if it covers scene and law, "auto" for the same with a warning if it does not,
            "never" for Python.
        options: options of `scheme.TimeStepping`.
    """
    if compiled == "never":
        warm_up()
    else:
        compile_together(_ENTRY)
    from impactlaw.stepping.time_stepping.scheme import TimeStepping

    scheme = TimeStepping(model, law, plan, **options)
    if compiled == "never":
        load_solvers()
        return scheme
    from impactlaw.stepping.time_stepping.compiled.stepping import CompiledStepping

    try:
        return CompiledStepping(scheme, warn=compiled == "auto")
    except UncompilableError as error:
        if compiled == "auto":
            warn_of_python(error)
        return scheme
