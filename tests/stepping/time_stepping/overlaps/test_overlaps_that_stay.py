"""Overlaps that no motion opens, as of the hulls of a gripper's palm and fingers: joints must not run away."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_GRIPPER = """<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <geom type="box" size="0.1 0.1 0.05"/>
    <body pos="0 0 0.07">
      <joint type="slide" axis="{axis}" range="{limits}" damping="1"/>
      <geom type="box" size="0.01 0.01 0.03" mass="0.1" friction="{friction}"/>
    </body>
  </worldbody>
</mujoco>"""  # the finger is 1 cm deep in the palm


def _path(steps=200, restitution=0.0, friction=0.5, **scene):
    """Return the position of the finger after each step, (steps,)."""
    model = mujoco.MjModel.from_xml_string(_GRIPPER.format(friction=friction, **scene))
    model.jnt_limited[:] = 1
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(restitution), scheme="time-stepping")
    path = []
    for _ in range(steps):
        stepper.step(data)
        path.append(float(data.qpos[0]))
    return np.array(path)


@pytest.mark.parametrize("friction", [0.05, 0.5, 2.0])
def test_a_finger_that_slides_across_its_palm_stays(friction):
    """To open 1 cm it would have to slide 10 m."""
    path = _path(axis="0 1 0.001", limits="-0.04 0.04", friction=friction)
    np.testing.assert_allclose(path, 0.0, atol=1e-6)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_what_overlaps_does_not_push_a_joint_beyond_its_limit(restitution):
    path = _path(axis="0 0 1", limits="-0.01 0.005", restitution=restitution)
    np.testing.assert_allclose(path[-1], 0.005, atol=1e-6)
    assert path.max() < 0.005 + 6e-4  # opened in one step


def test_what_can_be_opened_along_a_slope_is():
    path = _path(axis="0 0.95 0.3", limits="-0.1 0.1")
    np.testing.assert_allclose(path[-1], 0.01 * np.hypot(0.95, 0.3) / 0.3, atol=1e-4)


_DRIVEN = """<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <geom type="cylinder" size="0.03 0.05" pos="0 0 0.04" zaxis="0 1 0"/>
    <body pos="0 0.01 0.044">
      <joint name="slide" type="slide" axis="0 1 0" range="-0.0115 0.02" armature="1" damping="100"/>
      <geom type="box" size="0.005 0.00675 0.0375" pos="0 0.01725 0.04"/>
      <geom type="box" size="0.005 0.025 0.0085" pos="-0.005 -0.003 0.0083"/>
    </body>
  </worldbody>
  <actuator><position joint="slide" kp="1000"/></actuator>
</mujoco>"""  # a finger of robosuite's Rethink gripper


def test_a_finger_that_is_driven_does_not_leap():
    """Contact points that come and go are detected again at the end of a step, and opened there completely."""
    model = mujoco.MjModel.from_xml_string(_DRIVEN)
    data, path = mujoco.MjData(model), [0.0]
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for i in range(400):
        data.ctrl[0] = 0.02 if i // 100 % 2 == 0 else -0.011
        stepper.step(data)
        path.append(float(data.qpos[0]))
    assert np.abs(np.diff(path)).max() < 0.002
    assert min(path) > -0.0116
    assert max(path) < 0.021


def _squeezed(many: int) -> mujoco.MjModel:
    """Return a square of boxes with sides of 2 cm, 19 mm apart, that four walls squeeze: all overlap by 1 mm."""
    places = 0.019 * (np.arange(many) - 0.5 * (many - 1))
    slides = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
    box = '<geom type="box" size="0.01 0.01 0.01" density="1000"/>'
    boxes = "".join(f'<body pos="{x} {y} 0">{slides}{box}</body>' for x in places for y in places)
    far = 0.0095 * many + 0.02
    walls = "".join(
        f'<geom type="box" size="{a} {b} 0.05" pos="{x} {y} 0"/>'
        for a, b, x, y in ((0.02, 0.2, far, 0), (0.02, 0.2, -far, 0), (0.2, 0.02, 0, far), (0.2, 0.02, 0, -far))
    )
    free = '<body pos="1 0 .0095">{}<geom type="box" size=".01 .01 .01" density="1000"/></body>'
    floor = '<geom type="box" size=".1 .1 .01" pos="1 0 -.01"/>'
    lift = '<joint type="slide" axis="0 0 1"/>'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0"/><worldbody>{walls}{boxes}{floor}{free.format(lift)}</worldbody></mujoco>'
    )


@pytest.mark.parametrize("many", [1, 2, 4])
def test_overlaps_of_squeezed_boxes_do_not_grow(many):
    """A box between two walls went into one of them, 1 mm deep for .5 mm; a body elsewhere opens its own overlap."""
    model = _squeezed(many)
    data, seen = mujoco.MjData(model), mujoco.MjData(model)
    stepper, depths = Stepper(model, Moreau(0.5), scheme="time-stepping"), []
    for step in range(201):
        if step in (0, 200):
            seen.qpos[:] = data.qpos
            mujoco.mj_fwdPosition(model, seen)
            depths.append(-seen.contact.dist.min())
        stepper.step(data)
    assert depths[1] < depths[0] + 1e-7
    assert data.qpos[-1] == pytest.approx(5e-4, abs=1e-5)
    assert not data.qvel.any()
    assert stepper.short_steps == 0
