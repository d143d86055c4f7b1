"""Bodies that slide over floors of several boxes pass over the edges between them as MuJoCo leads them."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.scene.corrected import hidden_edges

SHAPES = {
    "box": '<geom type="box" size=".07 .05 .04" mass="1" friction="0" condim="1"/>',
    "puck": '<geom type="cylinder" size=".06 .04" mass="1" friction="0" condim="1"/>',
    "sphere": '<geom type="sphere" size=".04" mass="1" friction="0" condim="1"/>',
}
TILE, WALL = 'size=".5 .5 .1" pos=".5 0 -.1"', 'size=".1 .5 .3" pos=".1 0 .3"'


def _model(shape, ahead):
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option integrator="RK4"/>
      <worldbody>
        <geom type="box" size=".5 .5 .1" pos="-.5 0 -.1" friction="0" condim="1"/>
        <geom type="box" {ahead} friction="0" condim="1"/>
        <body pos="-.2 0 .04"><freejoint/>{SHAPES[shape]}</body>
      </worldbody>
    </mujoco>""")


def _slide(model, step):
    """Return the velocity after half a second over a floor that ends at x = 0."""
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    for _ in range(250):
        step(data)
    return data.qvel


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_that_have_sunk_into_the_floor_slide_on_over_the_next_box(shape, compiled):
    model = _model(shape, TILE)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)
    velocity = _slide(model, stepper.step)
    np.testing.assert_array_equal(velocity, _slide(model, lambda data: mujoco.mj_step(model, data)))
    assert velocity[0] > 0.9


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("shape", SHAPES)
def test_bodies_bounce_off_a_wall_on_the_floor(shape, compiled):
    model, collisions = _model(shape, WALL), []
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled=compiled)

    def step(data):
        stepper.step(data)
        collisions.extend(stepper.events)

    assert _slide(model, step)[0] < 0.0
    assert collisions


def test_contacts_of_bodies_on_one_geom_are_not_compared_with_each_other(monkeypatch):
    """Hundreds of contacts on a plane would cost more than the rest of the step."""

    def refuse(*_):
        raise AssertionError("a plane hides no edges")

    model = _model("box", 'size=".5 .5 .1" pos="9 0 -.1"')
    data, events = mujoco.MjData(model), []
    data.qvel[2] = -1.0
    monkeypatch.setattr(hidden_edges, "hides", refuse)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft", compiled="never")
    for _ in range(10):
        stepper.step(data)
        events.extend(stepper.events)
    assert len(events[0].contacts) == 4
