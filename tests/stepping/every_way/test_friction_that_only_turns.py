"""Contacts with torsional or rolling friction only: no pair of the scene has sliding friction."""

import mujoco
import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper


@pytest.mark.parametrize("scheme", ["time-stepping", "event-driven"])
@pytest.mark.parametrize(("condim", "friction", "spin"), [(4, "0 .1 0", 5), (6, "0 0 .1", 4)])
def test_a_ball_comes_to_rest(scheme, condim, friction, spin):
    geom = f'condim="{condim}" friction="{friction}"'
    floor = f'<geom type="plane" size="1 1 .1" {geom}/>'
    model, data = compiled(f'{floor}<body pos="0 0 .1"><freejoint/><geom size=".1" mass="1" {geom}/></body>')
    stepper = Stepper(model, Moreau(0.0), scheme=scheme)
    data.qvel[spin] = 5.0
    for _ in range(100):
        stepper.step(data)
    assert abs(data.qvel[spin]) < 1e-9


@pytest.mark.parametrize(("condim", "friction"), [(4, "0 .1 0"), (6, "0 0 .1"), (6, ".5 .1 .1")])
def test_overlaps_open(condim, friction):
    """A ball far from the axis about which its body turns easily: it spins fast while its overlap opens."""
    geom = f'condim="{condim}" friction="{friction}"'
    model, data = compiled(
        f"""<geom type="plane" size="1 1 .1" {geom}/><body pos="0 0 .009"><freejoint/>
            <inertial pos="0 0 0" mass=".001" diaginertia="1e-6 1e-6 1e-9" euler="0 45 0"/>
            <geom size=".01" pos="0 .01 0" {geom}/></body>""",
        option='gravity="0 0 0" timestep="2e-3"',
    )
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    for _ in range(200):
        stepper.step(data)
    mujoco.mj_forward(model, data)
    assert min(data.contact.dist, default=0.0) > -1e-9
    np.testing.assert_allclose(stepper.shortfall, 0.0, atol=1e-12)
