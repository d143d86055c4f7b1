"""Compiled soft collisions keep the velocities of equality constraints, as those in Python do."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Coulomb, Moreau, Stepper
from impactlaw.errors import UncompiledWarning
from impactlaw.stepping.soft.compiled.stepping import CompiledSoftStepping
from impactlaw.stepping.soft.scheme import SoftStepping

_WORLD = """<geom type="plane" size="5 5 .1"/>
  <body name="one" pos="0 0 .4" euler="20 30 0"><freejoint/><geom type="ellipsoid" size=".1 .15 .05"/></body>
  <body name="two" pos=".3 0 .4"><freejoint/><geom size=".08"/></body>
  <body pos="-.8 0 .3"><joint name="left" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 -.3 0 0" size=".03"/></body>
  <body pos="-.6 0 .3"><joint name="right" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body>
  <body pos="0 1 .5"><freejoint/><geom size=".1"/></body>"""
"""No body rests on a face, where friction would have several solutions between which rounding decides."""
_FINGER = """<geom type="plane" size="5 5 .1"/>
  <body pos="0 0 .12" euler="0 0 {turned}"><joint type="slide" axis="0 0 1"/><geom size=".01"/>
   <body pos=".03 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .03 0 -.03" size=".004"/>
    <body name="coupler" pos=".03 0 -.03"><joint axis="{tilt} 1 0"/>
     <geom type="capsule" fromto="0 0 0 0 0 -.04" size=".004"/></body></body>
   <body name="follower" pos=".01 0 -.02"><joint axis="0 1 {tilt}"/>
    <geom type="capsule" fromto="0 0 0 .03 0 -.03" size=".004"/></body></body>"""
"""A falling planar finger of four bars: one of the three rows that close it almost depends on the others."""
_LOOP = '<connect body1="coupler" body2="follower" anchor="0 0 -.02"/>'
_GEAR = '<joint joint1="left" joint2="right" polycoef="0 -.5 0 0 0"/>'
_WELD = '<weld body1="one" body2="two"/>'


def _compare(equality: str, law: object, option: str) -> tuple[int, float]:
    """Return how many of 400 steps collide, and the largest relative difference of velocities after one step."""
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


@pytest.mark.parametrize(("turned", "tilt"), [(0, 0.0), (45, 0.0), (45, 1e-4)])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_rows_that_depend_on_each_other_are_no_matter_for_python(monkeypatch, turned, tilt, e):
    world, loop = _FINGER.format(turned=turned, tilt=tilt), f"<equality>{_LOOP}</equality>"
    model, data = compiled(world, loop, option='timestep="2e-3"')
    ours = Stepper(model, Moreau(e), contact_model="soft", compiled="auto")
    python = Stepper(model, Moreau(e), contact_model="soft", compiled="never")
    collided, other = 0, mujoco.MjData(model)
    for _ in range(400):
        mujoco.mj_copyData(other, model, data)
        python.step(other)
        with monkeypatch.context() as nothing:
            nothing.setattr(SoftStepping, "step", _refuse)
            ours.step(data)
        collided += bool(python.events)
        np.testing.assert_allclose(data.qvel, other.qvel, rtol=0, atol=1e-8 * max(1.0, abs(other.qvel).max()))
    assert collided > 1


def _refuse(*_: object) -> None:
    raise AssertionError("a step was left to Python")


def test_scenes_with_equality_constraints_are_compiled(recwarn):
    model, data = compiled(_WORLD, f"<equality>{_WELD}</equality>", option='timestep="2e-3"')
    Stepper(model, Moreau(0.5), contact_model="soft", compiled="auto").step(data)
    assert not [warning for warning in recwarn if issubclass(warning.category, UncompiledWarning)]
