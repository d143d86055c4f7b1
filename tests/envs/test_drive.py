"""Drives keep their stroke and acceleration; in rigid stepping a driven surface hits with its own velocity."""

import numpy as np
import pytest
from own_envs import bare

from impactlaw.envs.tasks.drive import Drive
from impactlaw.envs.tasks.juggler import DRIVE as PADDLE
from impactlaw.envs.tasks.rocking_block import DRIVE as PLATFORM
from impactlaw.scene.tolerances import BLOW


@pytest.mark.parametrize("timestep", [0.05, 0.002, 1e-4])
def test_a_drive_keeps_to_stroke_and_acceleration(timestep):
    drive, rng = Drive(stroke=0.25, acceleration=45.0), np.random.default_rng(1)
    place = speed = farthest = fastest = 0.0
    for i in range(3000):
        part = rng.uniform(-1, 1) if (i // 300) % 2 else np.sign(np.sin(i * timestep))  # and also from end to end
        before, (place, speed) = speed, drive.advance(place, speed, part, timestep)
        assert abs(place) <= 0.25 + 1e-12
        assert abs(speed - before) <= 45.0 * timestep * (1 + 1e-9)
        farthest, fastest = max(farthest, abs(place)), max(fastest, abs(speed))
    assert farthest == pytest.approx(0.25, abs=1e-3) or timestep == 1e-4
    assert fastest > 1.0


def test_a_drive_moves_as_it_is_told_within_its_stroke():
    drive, place, speed = Drive(stroke=1.0, acceleration=2.0), 0.1, 0.0
    for _ in range(100):
        place, speed = drive.advance(place, speed, 0.5, 0.005)
    assert (place, speed) == pytest.approx((0.1 + 0.5 * 1.0 * 0.5**2, 0.5))


def test_the_drives_of_the_environments_never_strike():
    """For `Surfaces`, the changes of velocity from timestep to timestep are accelerations, not blows."""
    juggler, block = bare("impactlaw/Juggler-v0"), bare("impactlaw/RockingBlock-v0")
    assert juggler.model.opt.timestep * PADDLE.acceleration < BLOW
    size, place = block.model.geom("platform").size, block.model.geom("platform").pos
    reach = np.linalg.norm(size) + np.linalg.norm(place)
    assert block.model.opt.timestep * PLATFORM.acceleration * reach < BLOW


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_the_paddle_hits_with_its_own_velocity(e):
    """v+ = -e v- + (1 + e) w, where w has constant acceleration during the timesteps."""
    env = bare("impactlaw/Juggler-v0", frame_skip=1, restitution=e)
    env.reset(seed=2)
    env.data.qpos[0], env.data.qvel[0] = 0.4, -1.0
    start, events = None, []
    while not events:
        start = env.data.time if start is None and env.data.time > 0 else start
        env.step(np.array([0.3 if start is not None else 0.0]))
        events = env.stepper.events
    (event,) = events
    assert start is not None
    w = 0.3 * 45.0 * (event.time - start)
    drop = 0.4 - 0.5 * 0.3 * 45.0 * (event.time - start) ** 2
    before = -np.sqrt(1.0 + 2 * 9.81 * drop)
    collision = event.impact.collision
    assert collision.surface_velocity == pytest.approx([-w], rel=1e-6)
    assert collision.pre_velocity == pytest.approx([before], abs=1e-7)
    assert event.impact.post_velocity == pytest.approx([-e * before + (1 + e) * w], abs=1e-6)


def test_the_platform_tilts_and_lifts_the_block():
    """A block at rest on the platform moves along with it, and the energy of impacts is the work of the platform."""
    env = bare("impactlaw/RockingBlock-v0")
    env.reset(seed=0)
    env.data.qpos[:] = env.data.qvel[:] = 0
    for part in (0.1, -0.1):
        observation, *_ = env.step(np.array([part]))
    tilt, _, angle, turn, _, spin = observation
    assert tilt == pytest.approx(env.driven[0])
    assert 2 * np.arcsin(env.data.mocap_quat[0, 2]) == pytest.approx(tilt)
    assert tilt > 1e-3
    assert (angle, spin) == (pytest.approx(tilt, abs=1e-8), pytest.approx(turn, abs=1e-6))


@pytest.mark.parametrize("name", ["impactlaw/Juggler-v0", "impactlaw/RockingBlock-v0"])
def test_episodes_start_where_the_drive_is_at_rest(name):
    env = bare(name)
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.array([1.0]))
    assert env.driven[0] > 1e-3
    pose = env.data.mocap_pos.copy(), env.data.mocap_quat.copy()
    env.reset(seed=0)
    assert env.driven == (0.0, 0.0)
    assert not all(np.array_equal(*both) for both in zip(pose, (env.data.mocap_pos, env.data.mocap_quat), strict=True))
    env.data.qpos[0] += 0.5
    *_, info = env.step(np.array([1.0]))  # the way back to the start is not a motion, which would hit the ball
    assert info["impact/count"] == 0


def test_a_step_that_diverges_leaves_the_drive_where_it_was():
    env = bare("impactlaw/Juggler-v0")
    env.reset(seed=0)
    env.step(np.array([1.0]))
    before = env.driven
    env.model.opt.gravity[:] = np.nan
    *_, info = env.step(np.array([1.0]))
    assert info["impact/diverged"] == 1
    assert env.driven == before
