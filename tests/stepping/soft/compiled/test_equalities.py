"""Soft collisions in compiled code leave the velocities of equality constraints alone, as those in Python do."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Coulomb, Moreau, Stepper
from impactlaw.errors import UncompiledWarning
from impactlaw.stepping.soft.compiled.stepping import CompiledSoftStepping

_WORLD = """<geom type="plane" size="5 5 .1"/>
  <body name="one" pos="0 0 .4" euler="20 30 0"><freejoint/><geom type="box" size=".1 .15 .05"/></body>
  <body name="two" pos=".3 0 .4"><freejoint/><geom size=".08"/></body>
  <body pos="-.8 0 .3"><joint name="left" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 -.3 0 0" size=".03"/></body>
  <body pos="-.6 0 .3"><joint name="right" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body>
  <body pos="0 1 .5"><freejoint/><geom size=".1"/></body>"""
_GEAR = '<joint joint1="left" joint2="right" polycoef="0 -.5 0 0 0"/>'
_WELD = '<weld body1="one" body2="two"/>'


def _compare(equality: str, law: object, option: str) -> tuple[int, float]:
    """Return how many of 400 steps collide, and the largest difference of velocities after one, relative."""
    model, data = compiled(_WORLD, f"<equality>{equality}</equality>", option=f'timestep="2e-3" {option}')
    ours = Stepper(model, law, contact_model="soft", compiled="auto")  # pyright: ignore[reportArgumentType]
    python = Stepper(model, law, contact_model="soft", compiled="never")  # pyright: ignore[reportArgumentType]
    assert isinstance(ours.stepping, CompiledSoftStepping)
    other, collided, worst = mujoco.MjData(model), 0, 0.0
    for _ in range(400):
        mujoco.mj_copyData(other, model, data)
        ours.step(data)
        python.step(other)
        collided += bool(python.events)
        worst = max(worst, float(np.abs(data.qvel - other.qvel).max()) / max(1.0, float(np.abs(other.qvel).max())))
        assert bool(ours.sums.collisions) == bool(python.events)
    return collided, worst


@pytest.mark.parametrize(
    "equality", [_GEAR, _WELD, _GEAR + _WELD, _WELD + _WELD], ids=["gear", "weld", "both", "twice"]
)
@pytest.mark.parametrize("law", [Moreau(0.5), Coulomb(Moreau(0.4), tangential_restitution=0.3)], ids=["e", "slide"])
@pytest.mark.parametrize("option", ['integrator="Euler" jacobian="dense"', 'integrator="RK4" jacobian="sparse"'])
def test_compiled_collisions_are_those_of_python(equality, law, option):
    collided, worst = _compare(equality, law, option)
    assert collided > 5
    assert worst < 1e-9


def test_scenes_with_equality_constraints_are_compiled(recwarn):
    model, data = compiled(_WORLD, f"<equality>{_WELD}</equality>", option='timestep="2e-3"')
    Stepper(model, Moreau(0.5), contact_model="soft", compiled="auto").step(data)
    assert not [warning for warning in recwarn if issubclass(warning.category, UncompiledWarning)]
