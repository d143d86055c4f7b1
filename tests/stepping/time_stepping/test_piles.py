"""Piles of bodies: friction that is not unique, and contacts that come and go in each step."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_HALF, _SPACING = (0.004, 0.012, 0.024), 0.022


def _dominoes(count: int, push: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a row of dominoes, the first one pushed over at so many rad/s."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.default.geom.friction[0], spec.default.geom.density = 0.5, 500.0
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05])
    for i in range(count):
        body = spec.worldbody.add_body(pos=[i * _SPACING, 0.0, _HALF[2]])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=_HALF)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[[0, 2, 4]] = push * _HALF[2], push * _HALF[0], push
    return model, data


@pytest.mark.parametrize("push", [3.9, 4.0, 4.1])
def test_dominoes_that_lean_on_each_other_meet_the_law(push):
    model, data = _dominoes(16, push)
    stepper, missed = Stepper(model, Moreau(0.0), scheme="time-stepping"), []
    for _ in range(700):
        speed = max(1e-2, float(np.abs(data.qvel).max()))
        stepper.step(data)
        missed.append(stepper.shortfall / speed)
    assert data.qpos[2::7].max() < 0.6 * _HALF[2]  # all have fallen
    assert np.mean(np.array(missed) < 1e-6) > 0.99
    assert max(missed) < 5e-3
