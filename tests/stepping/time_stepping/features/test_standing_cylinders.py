"""Cylinders that stand on planes, where MuJoCo's contacts consist of rounding errors."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, MaximalDissipation, Moreau, Stepper

RADIUS, HALF = 0.03, 0.06  # m; a can stands on slopes up to a half
TURNS = 0.0, 0.3, 1.2, 2.0, 2.7, 4.5  # rad
TILTS = 0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-7  # rad
LEVEL, SLOPE = (0.0, 0.0, -9.81), (3.0, 0.0, -9.34)


def _cans(
    timestep: float, gravity: tuple[float, ...] = LEVEL, friction: float = 1.0, plane: float = 0.0, lift: float = 0.0
) -> mujoco.MjModel:
    """Return cans side by side, each with another turn, on a plane that is turned by an angle, rad."""
    normal = np.array([np.sin(plane), 0.0, np.cos(plane)])
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = timestep, gravity
    turned = np.array([np.cos(plane / 2), 0.0, np.sin(plane / 2), 0.0])
    surface, solid = [friction, 0.005, 0.0001], mujoco.mjtGeom.mjGEOM_CYLINDER
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1], quat=turned, friction=surface)
    for i, turn in enumerate(TURNS):
        quat = np.empty(4)
        mujoco.mju_mulQuat(quat, turned, np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]))
        body = spec.worldbody.add_body(pos=(HALF + lift) * normal + [0.0, i, 0.0], quat=quat)
        body.add_freejoint()
        body.add_geom(type=solid, size=[RADIUS, HALF, 0.0], friction=surface)
    return spec.compile()


def _stepper(model: mujoco.MjModel, e: float) -> Stepper:
    return Stepper(model, Moreau(e), scheme="time-stepping")


def _places(data: mujoco.MjData) -> np.ndarray:
    return data.qpos.reshape(-1, 7)[:, :3].copy()


def _tilt(data: mujoco.MjData, normal: np.ndarray) -> float:
    """Return the largest tilt of an axis from a normal, rad."""
    return max(float(np.linalg.norm(np.cross(axes.reshape(3, 3)[:, 2], normal))) for axes in data.xmat[1:])


def _run(stepper: Stepper, data: mujoco.MjData, seconds: float) -> None:
    for _ in range(round(seconds / stepper.model.opt.timestep)):
        stepper.step(data)


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize(
    ("gravity", "friction", "plane"),
    [(LEVEL, 1.0, 0.0), (LEVEL, 0.0, 0.0), (SLOPE, 1.0, 0.0), (LEVEL, 1.0, 0.4)],
    ids=["level", "frictionless", "slope", "turned plane"],
)
def test_cans_stand_where_they_are(e, timestep, gravity, friction, plane):
    model = _cans(timestep, gravity, friction, plane)
    data = mujoco.MjData(model)
    stepper, before = _stepper(model, e), _places(data)
    _run(stepper, data, 2.0)
    assert np.abs(_places(data) - before).max() < 1e-9
    assert _tilt(data, np.array([np.sin(plane), 0.0, np.cos(plane)])) < 1e-9
    assert stepper.short_steps == 0


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_cans_with_tiny_tilts_stand_on_a_slope(e, timestep):
    model = _cans(timestep, SLOPE)
    data = mujoco.MjData(model)
    for pose, tilt, turn in zip(data.qpos.reshape(-1, 7), TILTS, TURNS, strict=True):
        pose[3:] = np.cos(tilt / 2), np.sin(tilt / 2) * np.cos(turn), np.sin(tilt / 2) * np.sin(turn), 0.0
        pose[2] += RADIUS * tilt
    stepper, before = _stepper(model, e), _places(data)
    _run(stepper, data, 2.0)
    assert np.abs((_places(data) - before)[:, :2]).max() < 1e-9
    assert np.abs(_places(data)[:, 2] - HALF).max() <= 1.01 * RADIUS * TILTS[-1]
    assert _tilt(data, np.array([0.0, 0.0, 1.0])) <= 1.01 * TILTS[-1]


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_cans_dropped_flat_bounce_by_the_law_and_come_to_rest(timestep):
    model, bounces = _cans(timestep, lift=0.02), 0
    data = mujoco.MjData(model)
    stepper, before = _stepper(model, 0.5), _places(data)
    for _ in range(round(2.0 / timestep)):
        stepper.step(data)
        for event in stepper.events:
            bounces += 1
            impact = event.impact
            np.testing.assert_allclose(
                impact.post_contact_velocity, -0.5 * impact.collision.pre_contact_velocity, rtol=0.0, atol=1e-9
            )
        assert _tilt(data, np.array([0.0, 0.0, 1.0])) < 1e-9
    assert bounces >= 4
    assert np.abs(_places(data) - before + [0.0, 0.0, 0.02]).max() < 1e-9
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_cans_dropped_on_a_slope_come_to_rest_upright(timestep):
    model = _cans(timestep, SLOPE, lift=0.02)
    data, stepper = mujoco.MjData(model), _stepper(model, 0.5)
    _run(stepper, data, 2.0)
    assert _tilt(data, np.array([0.0, 0.0, 1.0])) < 1e-9
    assert np.ptp(_places(data)[:, 0]) < 1e-9
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("friction", [0.2, 0.45])
def test_cans_slide_to_a_stop_without_tipping(friction, timestep):
    """They would tip if the coefficient of friction were above a half."""
    model = _cans(timestep, friction=friction)
    data, stepper = mujoco.MjData(model), _stepper(model, 0.0)
    data.qvel.reshape(-1, 6)[:, 0] = 1.0
    for _ in range(round(0.6 / timestep)):
        stepper.step(data)
        assert _tilt(data, np.array([0.0, 0.0, 1.0])) < 1e-9
    way = _places(data) - [0.0, 0.0, HALF] - np.arange(len(TURNS))[:, None] * [0.0, 1.0, 0.0]
    np.testing.assert_allclose(way[:, 0], 1.0 / (2.0 * friction * 9.81), atol=2e-5)
    assert np.abs(way[:, 1:]).max() < 1e-9


def test_a_coin_lies_still():
    """Its upper face, which MuJoCo finds too, has no contacts."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.005" gravity="3 0 -9.34"/><worldbody>
        <geom type="plane" size="1 1 1"/><body pos="0 0 .0004" euler="0 0 50"><freejoint/>
        <geom type="cylinder" size=".01 .0004"/></body></worldbody></mujoco>""")
    data, stepper = mujoco.MjData(model), _stepper(model, 0.5)
    before = data.qpos.copy()
    _run(stepper, data, 2.0)
    assert data.ncon == 4
    assert np.abs(data.qpos - before).max() < 1e-9


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_cans_ride_on_a_plate_that_shakes(timestep):
    """The plate accelerates to 0.33 g; cans tip from a half, and triangles from a quarter."""
    cans = "".join(
        f'<body pos="0 {i} .06" euler="0 0 {np.degrees(turn)}"><freejoint/>'
        f'<geom type="cylinder" size="{RADIUS} {HALF}"/></body>'
        for i, turn in enumerate(TURNS)
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/><worldbody>
        <body name="plate" mocap="true"><geom type="plane" size="5 5 1"/></body>{cans}</worldbody></mujoco>""")
    data, stepper = mujoco.MjData(model), _stepper(model, 0.0)
    before, most, rate = _places(data), 0.33 * 9.81, 10.0
    for _ in range(round(1.5 / timestep)):
        angle = rate * (data.time + timestep)
        data.mocap_pos[0, :2] = most / rate**2 * (angle - np.sin(angle)) * np.array([0.6, 0.8])
        stepper.step(data)
        assert _tilt(data, np.array([0.0, 0.0, 1.0])) < 1e-9
        way = _places(data) - before
        assert np.ptp(way, axis=0).max() < 1e-9
        assert np.abs(way - data.mocap_pos[0]).max() < 1e-3


def _thrown(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return a state of cans: some stand, some are about to land on their faces, some tip over."""
    pose, speed = mujoco.MjData(model).qpos.reshape(-1, 7), np.zeros((len(TURNS), 6))
    pose[1:3, 2] += 0.01
    pose[2, 2] += 0.01
    speed[1], speed[2, 0], speed[3, 4], speed[4, 0] = [0.1, 0.0, -1.0, 0.2, 0.1, 3.0], 0.5, 2.0, 0.4
    return pose.ravel(), speed.ravel()


@pytest.mark.parametrize("gravity", [LEVEL, SLOPE], ids=["level", "slope"])
@pytest.mark.parametrize("plane", [0.4, 2.5])
def test_cans_move_as_in_a_scene_that_is_turned_with_gravity(plane, gravity):
    turned = np.array([np.cos(plane / 2), 0.0, np.sin(plane / 2), 0.0])
    axes = np.array([[np.cos(plane), 0.0, np.sin(plane)], [0.0, 1.0, 0.0], [-np.sin(plane), 0.0, np.cos(plane)]])
    level, steep = _cans(0.005, gravity), _cans(0.005, tuple(axes @ gravity), plane=plane)
    one, other = mujoco.MjData(level), mujoco.MjData(steep)
    one.qpos[:], one.qvel[:] = _thrown(level)
    other.qpos[:], other.qvel[:] = one.qpos, one.qvel
    other.qpos.reshape(-1, 7)[:, :3] = _places(one) @ axes.T
    other.qvel.reshape(-1, 6)[:, :3] = one.qvel.reshape(-1, 6)[:, :3] @ axes.T
    for pose in other.qpos.reshape(-1, 7):
        mujoco.mju_mulQuat(pose[3:], turned, pose[3:].copy())
    ours, theirs = _stepper(level, 0.5), _stepper(steep, 0.5)
    for _ in range(200):
        ours.step(one)
        theirs.step(other)
        assert np.abs(_places(other) - _places(one) @ axes.T).max() < 1e-10
    assert ours.short_steps == theirs.short_steps


def test_batches_are_steppers_bit_for_bit():
    model = _cans(0.005, SLOPE)
    data, stepper = mujoco.MjData(model), Stepper(model, MaximalDissipation(), scheme="time-stepping")
    batch = Batch(model, MaximalDissipation(), 3, 2)
    data.qpos[:], data.qvel[:] = _thrown(model)
    batch.bind("qpos")[:], batch.bind("qvel")[:] = data.qpos, data.qvel
    for _ in range(200):
        stepper.step(data)
        batch.step()
    for world in range(3):
        np.testing.assert_array_equal(batch.bind("qpos")[world], data.qpos)
        np.testing.assert_array_equal(batch.bind("qvel")[world], data.qvel)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_cans_rock_as_housners_block(turn):
    """Angular momentum about the new lowest point is what it was; the law of time stepping is of first order."""
    far, inertia, errors = RADIUS**2 + HALF**2, 0.25 * RADIUS**2 + HALF**2 / 3.0, []
    expected = (inertia + far - 2.0 * RADIUS**2) / (inertia + far)
    for timestep in (5e-4, 1e-4):
        model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{timestep}"/><worldbody>
            <geom type="plane" size="1 1 1" friction="2"/><body><freejoint/>
            <geom type="cylinder" size="{RADIUS} {HALF}" mass="1" friction="2"/></body></worldbody></mujoco>""")
        data, tilt, speeds = mujoco.MjData(model), 0.2, []
        data.qpos[2] = HALF * np.cos(tilt) + RADIUS * np.sin(tilt)
        data.qpos[3:] = np.cos(tilt / 2), np.sin(tilt / 2) * np.cos(turn), np.sin(tilt / 2) * np.sin(turn), 0.0
        stepper = _stepper(model, 0.0)
        for _ in range(round(0.8 / timestep)):
            stepper.step(data)
            speeds.append(np.linalg.norm(data.qvel[3:]))
        peaks = [b for a, b, c in zip(speeds, speeds[1:], speeds[2:], strict=False) if a < b >= c]
        errors.append(abs(peaks[1] / peaks[0] - expected))
    assert errors[0] < 0.02
    assert errors[1] < 0.004
