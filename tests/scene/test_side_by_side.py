"""Cylinders that touch along a line, side by side, leave each other parallel, as pucks on a table do."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Newton, Stepper

SCENE = """<mujoco><option timestep="0.001" integrator="RK4" gravity="0 0 {gravity}"/>
  <default><geom friction="0"/></default><worldbody>{floor}
  <body pos="{x} {y} .02" euler="0 0 {yaw}"><freejoint/>
    <geom name="one" type="cylinder" size=".04 .02" mass=".2"/></body>
  <body pos="0 0 {height}"><freejoint/><geom name="other" type="{kind}" size=".04 .02" mass=".2"/></body>
  </worldbody></mujoco>"""
ICE = '<geom name="ice" type="plane" size="9 9 1"/>'
NORMALS = 1e-6  # accuracy of the normals that MuJoCo finds for two cylinders
WAYS = {
    "event-driven": {"scheme": "event-driven"},
    "compiled": {"scheme": "time-stepping"},
    "python": {"scheme": "time-stepping", "compiled": "never"},
}


def thrown(angle, law, way, *, floor="", height=0.02, kind="cylinder"):
    """Return data after a cylinder was thrown at another one at 1 m/s, at an angle in degrees, and the direction."""
    out = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0])
    (x, y, _), gravity = -0.1 * out, -9.81 if floor else 0.0
    scene = SCENE.format(floor=floor, gravity=gravity, x=x, y=y, yaw=3 * angle, height=height, kind=kind)
    model = mujoco.MjModel.from_xml_string(scene)
    data, collisions = mujoco.MjData(model), 0
    data.qvel[:3] = out
    stepper = Stepper(model, law, **WAYS[way])
    for _ in range(40):
        stepper.step(data)
        collisions += sum("one/other" in event.contacts.labels for event in stepper.events)
    assert collisions == 1
    assert stepper.short_steps == stepper.unlocated == 0
    return data, out


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("angle", [0.0, 23.0, 100.0, -140.0])
def test_pucks_of_one_height_do_not_tip(angle, way):
    data, out = thrown(angle, Newton({("one", "other"): 0.8}, default=0.0), way, floor=ICE)
    np.testing.assert_allclose(data.qvel[:3], 0.1 * out, rtol=0.0, atol=NORMALS)
    np.testing.assert_allclose(data.qvel[6:9], 0.9 * out, rtol=0.0, atol=NORMALS)
    np.testing.assert_allclose(data.qvel[[3, 4, 9, 10]], 0.0, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("height", [0.03, 0.005])
def test_cylinders_that_are_shifted_along_their_axes_turn_alike(height, way):
    """The whole line of contact then opens with e times the speed at which it closed."""
    (data, _), e = thrown(0.0, Moreau(0.5), way, height=height), 0.5
    shift, inertia = 0.5 * (height - 0.02), 0.2 * (3 * 0.04**2 + 0.04**2) / 12
    impulse = (1 + e) / (2 / 0.2 + 2 * shift**2 / inertia)
    np.testing.assert_allclose(data.qvel[[0, 6]], [1 - impulse / 0.2, impulse / 0.2], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(data.qvel[[4, 10]], -shift * impulse / inertia, rtol=1e-6)


@pytest.mark.parametrize("way", WAYS)
def test_a_cylinder_beside_a_capsule(way):
    data, _ = thrown(0.0, Moreau(0.5), way, kind="capsule")
    np.testing.assert_allclose(data.qvel[[0, 6]], [0.25, 0.75], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(data.qvel[[4, 10]], 0.0, atol=1e-6)
