"""Light fingers with stiff joints, squeezed between their limits and a palm, do not burst."""

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper

LINK = """<joint name="{0}" axis="0 1 0" range="0 60" limited="true" damping="{1}"/>
  <inertial pos=".02 0 0" mass=".01" diaginertia="{2} {2} {2}"/>
  <geom type="capsule" fromto="0 0 0 .04 0 0" size=".01"/>"""


def finger(damping, inertia, overlap):
    """Two links that servos bend and stretch over a palm; h D is 4 to 67 times their moments of inertia."""
    first, second = (LINK.format(name, damping, inertia) for name in "ab")
    return compiled(
        f"""<geom type="box" size=".05 .05 .02" pos="0 0 {overlap - 0.02}"/>
        <body pos="0 0 .01">{first}<body pos=".045 0 0">{second}</body></body>""",
        '<actuator><position joint="a" kp="2"/><position joint="b" kp="2"/></actuator>',
        option='gravity="0 0 0"',
    )


def fastest(step, data):
    speeds = []
    for i in range(400):
        data.ctrl[:] = -0.3 if i // 40 % 2 else 0.3
        step(data)
        speeds.append(np.abs(data.qvel).max())
    return max(speeds)


@pytest.mark.parametrize(
    ("damping", "inertia", "overlap"),
    [(0.1, 1e-6, 5e-4), (0.1, 1e-6, 5e-3), (0.1, 5e-6, 5e-4), (0.1, 5e-6, 2e-3), (0.3, 5e-6, 5e-4), (1.0, 2e-5, 5e-4)],
)
def test_a_finger_between_its_limits_and_a_palm(damping, inertia, overlap):
    model, data = finger(damping, inertia, overlap)
    stepper = Stepper(model, Moreau(0.5), contact_model="soft")
    plain = mujoco.MjData(model)
    assert fastest(stepper.step, data) <= fastest(lambda plain: mujoco.mj_step(model, plain), plain) + 1e-9
