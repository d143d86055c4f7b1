"""A constraint that closes a limit by giving way does so in a collision, too."""

import numpy as np
import pytest
from scenes import compiled as compile_scene

from impactlaw import Moreau, Stepper

KNEE = """<body><joint name="knee" axis="0 1 0" range="0 120"/><geom size=".1" pos="0 0 -.4" mass="1"/>
    <body pos="0 0 -.4"><joint name="slip" type="slide" axis="1 0 0" range="0 .1" armature=".01"/>
    <geom size=".1" mass=".1"/></body></body>"""
COUPLING = '<equality><joint joint1="slip" joint2="knee" polycoef="0 .003 0 0 0"/></equality>'
"""A knee whose shank slips by 3 mm per radian, as those of musculoskeletal models; both joints end at 0."""


@pytest.mark.parametrize("compiled", ["auto", "never"])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_knee_is_not_thrown_back_by_the_slip_of_its_shank(e, compiled):
    """To stop a slip of 1 cm/s the knee would turn by 3.3 rad/s more."""
    model, data = compile_scene(KNEE, COUPLING, option='gravity="0 0 0"')
    data.qpos[:], data.qvel[:] = (-1e-3, -1e-5), (-1.0, -0.01)
    stepper = Stepper(model, Moreau(e), scheme="time-stepping", compiled=compiled)
    stepper.step(data)
    np.testing.assert_allclose(data.qvel[0], e, atol=1e-6)
    assert data.qvel[1] >= -1e-9
    assert stepper.short_steps == 0
