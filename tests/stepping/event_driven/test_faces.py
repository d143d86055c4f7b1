"""Faces with many corners, of which MuJoCo reports four: others in each step, as the body tilts by a nanometer."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

CORNERS, RADIUS, HEIGHT, MASS, TIMESTEP = 24, 0.04, 0.05, 0.4, 0.002
"""Corners of each base of a prism, its radius and half height, m, its mass, kg, and the timestep, s."""


def corners():
    """Return the corners of the prism, (2 CORNERS, 3)."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    base = RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.column_stack([base, np.full(CORNERS, z)]) for z in (-HEIGHT, HEIGHT)])


def scene(integrator):
    """Return a scene with a prism, and data in which it lies on a plane, level."""
    vertices = " ".join(f"{x:.7f}" for x in corners().ravel())
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{TIMESTEP}" integrator="{integrator}"/>
      <asset><mesh name="prism" vertex="{vertices}"/></asset>
      <worldbody>
        <geom type="plane" size="1 1 1"/>
        <body pos="0 0 {HEIGHT}"><freejoint/><geom type="mesh" mesh="prism" mass="{MASS}"/></body>
      </worldbody>
    </mujoco>""")
    return model, mujoco.MjData(model)


def energy(model, data):
    """Return the energy, J, at the current position and velocity."""
    copy = mujoco.MjData(model)
    copy.qpos[:], copy.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(model, copy)
    mujoco.mj_energyPos(model, copy)
    mujoco.mj_energyVel(model, copy)
    return copy.energy.sum()


def tilt(data, angle, towards):
    """Tilt the prism at rest by an angle, rad, so that one corner of its base touches the plane."""
    mujoco.mju_axisAngle2Quat(data.qpos[3:], np.array([np.cos(towards), np.sin(towards), 0.0]), angle)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, data.qpos[3:])
    data.qpos[2] = -(corners() @ turn.reshape(3, 3)[2]).min()


@pytest.mark.parametrize("towards", [0.1, 0.7])
@pytest.mark.parametrize("angle", [1e-7, 1e-6])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_prism_at_rest_on_one_of_its_corners_lies_down_and_stays(restitution, angle, towards):
    """It falls by no more than 80 nm: without contact it would have 20 mm/s at the end of the first step."""
    model, data = scene("Euler")
    tilt(data, angle, towards)
    stepper, before = Stepper(model, Moreau(restitution)), energy(model, data)
    for _ in range(5):
        stepper.step(data)
        now = energy(model, data)
        assert now <= before + 1e-12
        before = now
    np.testing.assert_allclose(data.qvel, 0.0, atol=1e-9)
    assert stepper.unlocated == 0
