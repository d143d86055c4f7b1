"""Turning surfaces carry bodies along in every way to step."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Batch, Moreau, Stepper

WAYS: dict[str, dict[str, Any]] = {
    "event-driven": {"scheme": "event-driven"},
    "time-stepping": {"scheme": "time-stepping"},
    "soft": {"contact_model": "soft"},
    "soft in Python": {"contact_model": "soft", "compiled": "never"},
    "batch": {"contact_model": "rigid"},
}
every_way = pytest.mark.parametrize("way", WAYS)

DRUM = """<body mocap="true" quat="1 1 0 0"><geom type="cylinder" size=".5 1"/></body>
<body pos="0 0 .8"><freejoint/><geom size=".1" mass="1"/></body>"""
RATE = 3.0  # rad/s


def poses(length: float, steps: int):
    """Return quaternions of this length for a drum that turns about y."""
    for k in range(steps):
        angle, turned = 0.5 * RATE * 0.002 * k, np.empty(4)
        mujoco.mju_mulQuat(turned, np.array([np.cos(angle), 0, np.sin(angle), 0]), np.array([0.5, 0.5, 0, 0]) ** 0.5)
        yield length * turned


@pytest.mark.parametrize("length", [1.0, 2.0, 0.5, -1.0])
@every_way
def test_a_drum_throws_a_ball_whatever_the_length_of_its_quaternion(way, length):
    """MuJoCo takes quaternions of any length. A ball that sticks leaves with two sevenths of the drum's speed."""
    model, data = compiled(DRUM, option='timestep=".002" integrator="RK4"')
    if way == "batch":
        batch = Batch(model, Moreau(0.5), 1, 1, **WAYS[way])
        for quaternion in poses(length, 115):
            batch.bind("mocap_quat")[0, 0] = quaternion
            batch.step()
        data.qvel[:] = batch.bind("qvel")[0]
    else:
        stepper = Stepper(model, Moreau(0.5), **WAYS[way])
        for quaternion in poses(length, 115):
            data.mocap_quat[0] = quaternion
            stepper.step(data)
    assert data.qvel[0] == pytest.approx(2 / 7 * RATE * 0.5, rel=0.01)


def velocity_after(steps: int, way: str, law: Moreau, world: str, friction: str) -> np.ndarray:
    """Return the angular velocity of a ball on a turntable after some steps, rad/s, (3,)."""
    model, data = compiled(world, option='timestep=".002" cone="elliptic"', geom=f'friction="{friction}"')
    if way == "batch":
        batch = Batch(model, law, 1, 1, **WAYS[way])
        batch.step(nstep=steps)
        return batch.bind("qvel")[0, 3:].copy()
    stepper = Stepper(model, law, **WAYS[way])
    for _ in range(steps):
        stepper.step(data)
    return data.qvel[3:]


@every_way
@pytest.mark.parametrize("height", [0.1, 0.4])
def test_a_turntable_spins_a_ball_at_its_centre(way, height):
    """The angular part of ``surfacevel`` acts through torsional friction, in held contact and in collisions."""
    world = f"""<geom type="plane" size="9 9 .1" condim="4" surfacevel="0 0 0 0 0 {RATE}"/>
    <body pos="0 0 {height}"><freejoint/><geom size=".1" mass="1" condim="4"/></body>"""
    assert velocity_after(140, way, Moreau(0.5), world, "1 .05 .001")[2] == pytest.approx(RATE, rel=1e-3)


@every_way
def test_a_turntable_does_not_roll_a_ball(way):
    """Only the normal component of the angular part counts, as in MuJoCo."""
    world = f"""<geom type="plane" size="9 9 .1" condim="6" surfacevel="0 0 0 {RATE} 0 0"/>
    <body pos="0 0 .12"><freejoint/><geom size=".1" mass="1" condim="6"/></body>"""
    assert np.abs(velocity_after(60, way, Moreau(0.0), world, "1 .05 .05")).max() < 1e-3
