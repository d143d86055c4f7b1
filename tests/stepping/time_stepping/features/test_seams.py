"""Bodies that slide over floors of several boxes pass over the edges between them."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

SHAPES = {
    "box": '<geom type="box" size=".07 .05 .04" mass="1" friction="0" condim="1"/>',
    "puck": '<geom type="cylinder" size=".06 .04" mass="1" friction="0" condim="1"/>',
    "sphere": '<geom type="sphere" size=".04" mass="1" friction="0" condim="1"/>',
}


def _slide(shape, ahead, **options):
    """Return the velocity after half a second over a floor that ends at x = 0, and the number of collisions."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option integrator="RK4"/>
      <worldbody>
        <geom type="box" size=".5 .5 .1" pos="-.5 0 -.1" friction="0" condim="1"/>
        <geom type="box" {ahead} friction="0" condim="1"/>
        <body pos="-.2 0 .04" euler="0 0 20"><freejoint/>{SHAPES[shape]}</body>
      </worldbody>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    stepper, collisions = Stepper(model, Moreau(0.5), scheme="time-stepping", **options), 0
    for _ in range(250):
        stepper.step(data)
        collisions += stepper.sums.collisions
    assert stepper.short_steps == 0
    return data.qvel, collisions


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_slide_on_over_the_next_box(shape, compiled):
    velocity, collisions = _slide(shape, 'size=".5 .5 .1" pos=".5 0 -.1"', compiled=compiled)
    np.testing.assert_allclose(velocity, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-7)
    assert collisions == 0


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_bounce_off_a_wall_on_the_floor(shape, compiled):
    velocity, collisions = _slide(shape, 'size=".1 .5 .3" pos=".1 0 .3"', compiled=compiled)
    assert collisions > 0
    assert velocity[0] < 0.0


def test_a_puck_hits_a_step():
    velocity, collisions = _slide("puck", 'size=".5 .5 .1" pos=".5 0 -.09999"')
    assert collisions > 0
    assert velocity[0] < 0.5


def test_a_sphere_hits_the_edge_of_a_step():
    velocity, collisions = _slide("sphere", 'size=".5 .5 .1" pos=".5 0 -.098"')
    assert collisions > 0
    assert velocity[0] < 1.0 - 1e-3
