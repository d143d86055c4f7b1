"""Bodies that touch and fly together: their contacts carry nothing, and differ in velocity by rounding only."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau

from .stepped import FLOOR, stepping

SLABS = 10
SIZE = '<geom type="box" size="0.05 0.05 0.02" pos="{} 0 0"/>'


def slabs(gravity):
    """Return a stack of slabs of four boxes each, 2 m above the floor."""
    geoms = "".join(SIZE.format(x) for x in (-0.18, -0.06, 0.06, 0.18))
    bodies = "".join(f'<body pos="0.1 0.2 {2 + 0.04 * i}"><freejoint/>{geoms}</body>' for i in range(SLABS))
    option = f'<option timestep="0.002" gravity="0 0 {-gravity}"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{FLOOR}{bodies}</worldbody></mujoco>")


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_steps_in_flight_are_easy(gravity):
    """The way is that of a point, without rounding in MuJoCo's sums; no problem is hard, and no step misses the law."""
    model = slabs(gravity)
    data, start = mujoco.MjData(model), np.tile([0.3, 0.1, 0.0, 0.0, 0.0, 0.0], SLABS)
    data.qvel[:] = start
    stepper = stepping(model, Moreau(0.0))
    for _ in range(100):
        stepper.step(data)
        assert data.ncon == 16 * (SLABS - 1)
        assert not data.efc_force.any()
    assert stepper.short_steps == 0
    start[2::6] = -gravity * data.time
    np.testing.assert_allclose(data.qvel, start, atol=1e-13)
