"""Bodies that grow after their stepper is made: contacts are detected up to their current size."""

import mujoco
import numpy as np

from impactlaw import Batch, Moreau, Stepper

_ROD = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="9 9 1"/>
    <body pos="0 0 .7">
      <freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>
      <geom name="rod" type="capsule" size=".02 .05" euler="0 90 0"/>
    </body>
  </worldbody>
</mujoco>"""
_SHAPE = ("geom_size", "geom_rbound", "geom_aabb")


def grow(fields):
    """Make the rod 2 m long, in arrays given by name."""
    fields["geom_size"][..., 1, 1], fields["geom_rbound"][..., 1] = 1.0, 1.02


def grow_model(model):
    grow({name: getattr(model, name) for name in ("geom_size", "geom_rbound")})


def spun(*, late):
    """Return the states of a rod that spins and hits the floor; it grows before its stepper is made, or later."""
    model = mujoco.MjModel.from_xml_string(_ROD)
    data = mujoco.MjData(model)
    if not late:
        grow_model(model)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    if late:
        grow_model(model)
    data.qvel[4], states = 40.0, []
    for _ in range(50):
        stepper.step(data)
        states.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(states)


def test_a_body_that_grows_later_hits_as_one_that_was_so_large():
    np.testing.assert_array_equal(spun(late=True), spun(late=False))


def test_bodies_that_are_larger_in_some_worlds():
    batch = Batch(mujoco.MjModel.from_xml_string(_ROD), Moreau(0.5), 3, 1)
    grow({name: batch.expand(name)[1:] for name in ("geom_size", "geom_rbound")})
    batch.bind("qvel")[:, 4] = 40.0
    batch.step(nstep=50)
    states = np.hstack([batch.bind("qpos"), batch.bind("qvel")])
    expected = spun(late=False)[-1]
    np.testing.assert_array_equal(states[1:], [expected, expected])
    assert abs(states[0] - expected).max() > 1.0


_PADDLE = """<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <body mocap="true"><geom name="paddle" type="box" size=".05 .02 .02"/></body>
    <body pos=".6 .3 0"><freejoint/><geom name="ball" size=".02" mass="1"/></body>
  </worldbody>
</mujoco>"""


def lengthen(fields):
    """Make the paddle 2 m long, in arrays given by name."""
    fields["geom_size"][..., 0, 0], fields["geom_rbound"][..., 0], fields["geom_aabb"][..., 0, 3] = 1.0, 1.0004, 1.0


def turned(step):
    """Return the orientation of a paddle that turns at 25 rad/s."""
    return [np.cos(0.025 * step), 0.0, 0.0, np.sin(0.025 * step)]


def struck(*, late):
    """Return the velocity of a ball struck by a paddle, which grows before its stepper is made, or later."""
    model = mujoco.MjModel.from_xml_string(_PADDLE)
    data, fields = mujoco.MjData(model), {name: getattr(model, name) for name in _SHAPE}
    if not late:
        lengthen(fields)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    if late:
        lengthen(fields)
    for step in range(60):
        data.mocap_quat[0] = turned(step + 1)
        stepper.step(data)
    return data.qvel.copy()


def test_a_moving_surface_that_grows_later_strikes_as_one_that_was_so_large():
    expected = struck(late=False)
    assert np.linalg.norm(expected[:3]) > 10.0
    np.testing.assert_array_equal(struck(late=True), expected)


def test_moving_surfaces_that_are_larger_in_some_worlds():
    batch = Batch(mujoco.MjModel.from_xml_string(_PADDLE), Moreau(0.5), 3, 1)
    lengthen({name: batch.expand(name)[1:] for name in _SHAPE})
    for step in range(60):
        batch.bind("mocap_quat")[:, 0] = turned(step + 1)
        batch.step()
    expected = struck(late=False)
    np.testing.assert_array_equal(batch.bind("qvel"), [np.zeros(6), expected, expected])
