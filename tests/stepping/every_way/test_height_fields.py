"""Bodies that slide or roll over height fields and floors of several pieces pass over the edges between the pieces."""

import mujoco
import numpy as np
import pytest
from scenes import WAYS

from impactlaw import Moreau, Stepper

SHAPES = {
    "sphere": 'type="sphere" size=".1"',
    "box": 'type="box" size=".1 .1 .1"',
    "mesh": 'type="mesh" mesh="cube"',
    "puck": 'type="cylinder" size=".1 .1"',
    "wheel": 'type="cylinder" size=".1 .05" euler="90 0 0"',
    "capsule": 'type="capsule" size=".1 .2" euler="90 0 0"',
}
CUBE = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
FIELD = '<geom type="hfield" hfield="terrain" friction="{mu} 0 0"/>'
TILES = "".join(
    f'<geom type="box" size=".125 3 .2" pos="{-3 + 0.25 * i} 0 -.2" friction="{{mu}} 0 0"/>' for i in range(25)
)


def scene(shape, floor, *, friction=0.0, step=0.0, timestep=0.002):
    """Return a floor with a body at x = -1, and a height field that has a step at x = 0, m."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{timestep}"/>
      <asset>
        <hfield name="terrain" nrow="41" ncol="41" size="5 5 1 .5"/>
        <mesh name="cube" vertex="{CUBE}"/>
      </asset>
      <worldbody>
        {floor.format(mu=friction)}
        <body pos="-1 .03 .1"><freejoint/><geom {SHAPES[shape]} mass="1" friction="{friction} 0 0"/></body>
      </worldbody>
    </mujoco>""")
    model.hfield_data.reshape(41, 41)[:, 20:] = step
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    return model, data


@pytest.mark.parametrize("floor", [FIELD, TILES], ids=["field", "tiles"])
@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_slide_on_in_time_stepping(shape, floor):
    model, data = scene(shape, floor)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    for _ in range(400):
        stepper.step(data)
    if floor == TILES:
        np.testing.assert_allclose(data.qvel[:3], [2.0, 0.0, 0.0], atol=2e-3)
    assert data.qvel[0] > 1.9  # MuJoCo does not find all contacts with prisms, so that bodies can tilt a little
    assert stepper.short_steps == 0


@pytest.mark.parametrize("floor", [FIELD, TILES], ids=["field", "tiles"])
@pytest.mark.parametrize("shape", ["sphere", "wheel", "capsule"])
def test_bodies_roll_on_in_time_stepping(shape, floor):
    model, data = scene(shape, floor, friction=0.5)
    data.qvel[4] = 20.0
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    for _ in range(400):
        stepper.step(data)
    assert data.qvel[0] == pytest.approx(2.0, abs=0.05)
    assert data.qvel[4] == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("floor", [FIELD, TILES], ids=["field", "tiles"])
@pytest.mark.parametrize("shape", ["box", "mesh", "puck"])
def test_the_law_of_soft_steps_does_not_act_on_hidden_edges(shape, floor, compiled):
    """MuJoCo's own contacts with these edges remain, and slow bodies down a little.

    A corner that has sunk in deep can meet the side of a prism: so does one box of nine or so.
    """
    model, data = scene(shape, floor)
    alone, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    slowed = []
    for turning in np.linspace(-1.0, 1.0, 9):
        mujoco.mj_resetData(model, data)
        data.qvel[[0, 5]] = 2.0, turning
        mujoco.mj_resetData(model, alone)
        alone.qvel[:] = data.qvel
        for _ in range(400):
            stepper.step(data)
            mujoco.mj_step(model, alone)
        slowed.append(alone.qvel[0] - data.qvel[0])
    assert np.median(slowed) < 0.1


@pytest.mark.parametrize("way", ["time-stepping", "soft", "soft in Python"])
@pytest.mark.parametrize("shape", ["box", "mesh", "puck"])
def test_bodies_bounce_off_a_step_of_a_height_field(shape, way):
    """How fast one body leaves depends on the prisms that MuJoCo finds, and so on the last digits of its start."""
    least = []
    for start in range(9):
        model, data = scene(shape, FIELD, step=0.15)
        data.qpos[0] += 1e-3 * start
        stepper = Stepper(model, Moreau(0.5), **WAYS[way])
        least.append(2.0)
        for _ in range(500):
            stepper.step(data)
            least[-1] = min(least[-1], data.qvel[0])
        assert data.qpos[0] < 0.0
    assert np.median(least) < -0.3


@pytest.mark.parametrize("scheme", ["time-stepping", "event-driven"])
@pytest.mark.parametrize(("shape", "height"), [('size=".2"', 0.2), ('type="ellipsoid" size=".3 .2 .1"', 0.1)])
def test_bodies_fall_on_fine_height_fields(shape, height, scheme):
    """MuJoCo stops at 50 contacts of two geoms: with wide margins it does not get to the nearest of these prisms."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="0.002" integrator="implicitfast"/>
      <asset><hfield name="terrain" nrow="201" ncol="201" size="2 2 1 .3"/></asset>
      <worldbody>
        <geom type="hfield" hfield="terrain"/>
        <body pos=".013 .027 .3"><freejoint/><geom {shape} density="500"/></body>
      </worldbody>
    </mujoco>""")
    model.hfield_data[:] = 0.0
    data = mujoco.MjData(model)
    data.qvel[2] = -3.0
    stepper = Stepper(model, Moreau(0.0), scheme=scheme)
    stepper.step(data, 150)
    np.testing.assert_allclose(data.qpos[:3], [0.013, 0.027, height], atol=1e-4)
    np.testing.assert_allclose(data.qpos[4:], 0.0, atol=1e-3)
    assert stepper.short_steps == 0
