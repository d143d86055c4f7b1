"""Cylinders that stand, slide and tip on planes, turned about their axes, which must not matter.

A can tips where the force at its base leaves the base: on slopes, or with coefficients of friction, above a half. The
triangles of contact points that MuJoCo finds tip from a quarter in some directions.
"""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

RADIUS, HALF, GRAVITY = 0.03, 0.06, 9.81
TURNS = 0.0, 0.3, 1.2, 2.0, 2.7, 4.5  # rad


def cans(angle: float, friction: float, *, turned: bool = False, integrator: str = "RK4", plane: str = "", e=0.0):
    """Return the data and the stepper of cans on a slope, rad, of gravity or of the plane."""
    down = 0.0 if turned else angle
    away = HALF * np.array([np.sin(angle - down), 0.0, np.cos(angle - down)])
    bodies = "".join(
        f'<body pos="{away[0]} {i} {away[2]}" quat="{_quat(angle - down, turn)}"><freejoint/>'
        f'<geom type="cylinder" size="{RADIUS} {HALF}" mass="1"/></body>'
        for i, turn in enumerate(TURNS)
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="2e-3" integrator="{integrator}"
        gravity="{GRAVITY * np.sin(down)} 0 {-GRAVITY * np.cos(down)}"/>
        <default><geom friction="{friction}"/></default><worldbody>
        <body mocap="true" quat="{_quat(angle - down, 0.0)}"><geom type="plane" size="5 5 1" {plane}/></body>{bodies}
        </worldbody></mujoco>""")
    return mujoco.MjData(model), Stepper(model, Moreau(e))


def _quat(tilt: float, turn: float) -> str:
    quat = np.empty(4)
    about_y = np.array([np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0])
    mujoco.mju_mulQuat(quat, about_y, np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]))
    return " ".join(f"{x:.17g}" for x in quat)


def places(data: mujoco.MjData) -> np.ndarray:
    return data.qpos.reshape(-1, 7)[:, :3].copy()


def tilts(data: mujoco.MjData) -> np.ndarray:
    """Return the angles of the axes to the normal of the plane, rad."""
    axes = data.geom_xmat.reshape(-1, 3, 3)[:, :, 2]
    return np.linalg.norm(np.cross(axes[1:], axes[0]), axis=1)


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("turned", [False, True], ids=["gravity", "plane"])
def test_cans_stand_on_a_slope(turned, e):
    data, stepper = cans(np.arctan(0.48), 1.0, turned=turned, integrator="Euler", e=e)
    before = places(data)
    for _ in range(50):
        stepper.step(data)
        assert len(stepper.events) == 0
    assert np.abs(places(data) - before).max() < 1e-12
    assert tilts(data).max() < 1e-12


@pytest.mark.parametrize("velocity", [0.3, -0.3], ids=["downwards", "upwards"])
def test_cans_slide_on_a_slope_without_tipping(velocity):
    angle, friction = np.arctan(0.6), 0.45
    data, stepper = cans(angle, friction)
    before, duration = places(data), 0.03
    data.qvel.reshape(-1, 6)[:, 0] = velocity
    for _ in range(15):
        stepper.step(data)
        assert tilts(data).max() < 1e-12
    slowing = GRAVITY * (np.sin(angle) - np.sign(velocity) * friction * np.cos(angle))
    way = velocity * duration + 0.5 * slowing * duration**2
    np.testing.assert_allclose(places(data) - before, [[way, 0.0, 0.0]] * len(TURNS), atol=1e-10)


def test_cans_tip_over_the_lowest_point_of_their_rims():
    """Tilts are ``excess (cosh(rate t) - 1)`` while they are small: an inverted pendulum on that point."""
    limit, duration = np.arctan2(RADIUS, HALF), 0.06
    data, stepper = cans(1.05 * limit, 1.0)
    for _ in range(30):
        stepper.step(data)
    far = np.hypot(RADIUS, HALF)
    inertia = 0.25 * RADIUS**2 + HALF**2 / 3.0 + far**2
    tilt = 0.05 * limit * (np.cosh(np.sqrt(GRAVITY * far / inertia) * duration) - 1.0)
    np.testing.assert_allclose(tilts(data), tilt, rtol=1e-3)
    assert np.abs(data.qpos.reshape(-1, 7)[:, 1] - np.arange(len(TURNS))).max() < 1e-6


def test_cans_ride_on_a_plate_that_shakes():
    """The plate accelerates to 0.33 g."""
    data, stepper = cans(0.0, 1.0)
    before, rate = places(data), 10.0
    for _ in range(100):
        angle = rate * (data.time + 2e-3)
        data.mocap_pos[0, :2] = 0.33 * GRAVITY / rate**2 * (angle - np.sin(angle)) * np.array([0.6, 0.8])
        stepper.step(data)
    assert tilts(data).max() < 1e-9
    assert np.ptp(places(data) - before, axis=0).max() < 1e-9


def test_cans_are_carried_off_by_a_belt():
    data, stepper = cans(0.0, 0.45, plane='surfacevel="-.6 .8 0 0 0 0"')
    before, duration = places(data), 0.08
    for _ in range(40):
        stepper.step(data)
    way = 0.5 * 0.45 * GRAVITY * duration**2 * np.array([-0.6, 0.8, 0.0])
    np.testing.assert_allclose(places(data) - before, [way] * len(TURNS), atol=1e-9)
    assert tilts(data).max() < 1e-9


@pytest.mark.parametrize("integrator", ["RK4", "Euler"])
def test_cans_rock_as_housners_block(integrator):
    """Angular momentum about the new lowest point is what it was; rims meet the plane again at that point alone."""
    half, tilt = 0.15, 0.1
    far, inertia = 0.05**2 + half**2, 0.25 * 0.05**2 + half**2 / 3.0
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="1e-3" integrator="{integrator}"/><worldbody>
        <geom type="plane" size="1 1 1" friction="2"/><body quat="{_quat(tilt, 0.7)}"
        pos="0 0 {half * np.cos(tilt) + 0.05 * np.sin(tilt)}"><freejoint/>
        <geom type="cylinder" size=".05 {half}" mass="1" friction="2"/></body></worldbody></mujoco>""")
    data, stepper, kept = mujoco.MjData(model), Stepper(model, Moreau(0.0)), []
    for _ in range(500):
        stepper.step(data)
        for event in stepper.events:
            before, after = event.impact.collision.pre_velocity, event.impact.post_velocity
            kept.append(np.linalg.norm(after[3:]) / np.linalg.norm(before[3:]))
    assert len(kept) >= 2
    np.testing.assert_allclose(kept, (inertia + far - 2.0 * 0.05**2) / (inertia + far), rtol=1e-4)
