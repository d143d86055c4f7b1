"""Collisions whose gap is open at both ends of a step: grazing balls, hard disks, spinning rods, a ceiling."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

RADIUS = 0.05  # m
ELASTIC = Moreau(1.0)
PLANAR = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
CLOSE = 1e-3  # m; each of 30 collisions multiplies errors of 1e-9; a missed one moves disks by centimetres


def compiled(world, timestep, integrator="RK4", gravity="0 0 0"):
    option = f'<option timestep="{timestep}" gravity="{gravity}" integrator="{integrator}"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{world}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


def disk(x, y):
    return f'<body pos="{x} {y} 0">{PLANAR}<geom size="{RADIUS}" mass="1"/></body>'


@pytest.mark.parametrize("integrator", ["RK4", "Euler"])
@pytest.mark.parametrize(("speed", "timestep"), [(1.0, 0.002), (5.0, 0.005), (20.0, 0.005)])
@pytest.mark.parametrize("overlap", [1e-2, 1e-3, 1e-4, 1e-6])
def test_grazing_ball_is_deflected_by_the_exact_angle(speed, timestep, overlap, integrator):
    """The angle for a fixed ball is ``2 asin(v_n / v)``, wherever steps start."""
    offset = 2.0 * RADIUS - overlap
    along = np.sqrt(1.0 - (offset / (2.0 * RADIUS)) ** 2)  # v_n / v
    for part in np.linspace(0.0, 0.9, 7):
        x = -0.3 - part * speed * timestep
        model, data = compiled(f'<geom size="{RADIUS}"/>{disk(x, offset)}', timestep, integrator)
        data.qvel[0] = speed
        stepper = Stepper(model, ELASTIC, friction="ignore")
        count = 0
        while data.time < 0.5 / speed:
            stepper.step(data)
            count += len(stepper.events)
        assert count == 1
        angle = 2.0 * np.arcsin(along)
        np.testing.assert_allclose(data.qvel, speed * np.array([np.cos(angle), np.sin(angle)]), atol=speed * 1e-5)


def next_wall(x, v, size):
    """Return when a disk hits a wall next, s, and along which axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(v > 0, (size - RADIUS - x) / v, np.where(v < 0, (RADIUS - x) / v, np.inf))
    i, k = np.unravel_index(times.argmin(), times.shape)
    return times[i, k], (i, k)


def next_pair(x, v):
    """Return when two disks hit each other next, s, and which."""
    i, j = np.triu_indices(len(x), 1)
    d, w = x[i] - x[j], v[i] - v[j]
    b, a, c = np.vecdot(d, w), np.vecdot(w, w), np.vecdot(d, d) - 4.0 * RADIUS**2
    root = b * b - a * c
    times = np.where((b < 0) & (root > 0), (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
    k = times.argmin()
    return times[k], (i[k], j[k])


def exact_disks(x, v, duration, size):
    """Return the positions of equal elastic disks in a square after a time, s, and the number of pair collisions."""
    x, v, left, count = x.copy(), v.copy(), duration, 0
    while True:
        (wall, (i, k)), (pair, (a, b)) = next_wall(x, v, size), next_pair(x, v)
        time = min(wall, pair, left)
        x += v * time
        left -= time
        if left <= 0.0:
            return x, count
        if wall < pair:
            v[i, k] *= -1.0
        else:
            normal = (x[a] - x[b]) / np.linalg.norm(x[a] - x[b])
            jump = (v[a] - v[b]).dot(normal) * normal
            v[a] -= jump
            v[b] += jump
            count += 1


@pytest.mark.parametrize("seed", [6, 7, 16, 19, 20, 22])
def test_hard_disks_move_as_they_do_exactly(seed):
    """Eight disks in a square, with steps in which they move by up to their size."""
    rng, size, duration, timestep = np.random.default_rng(seed), 1.0, 0.25, 0.01
    grid = np.array([(0.2 + 0.3 * i, 0.2 + 0.3 * j) for i in range(3) for j in range(3)])[:8]
    x, v = grid + rng.uniform(-0.09, 0.09, grid.shape), 6.0 * rng.normal(size=grid.shape)
    walls = "".join(
        f'<geom name="wall{i}" type="plane" size="5 5 1" pos="{place}" zaxis="{axis}"/>'
        for i, (place, axis) in enumerate(
            [("0 0 0", "1 0 0"), (f"{size} 0 0", "-1 0 0"), ("0 0 0", "0 1 0"), (f"0 {size} 0", "0 -1 0")]
        )
    )
    model, data = compiled(walls + "".join(disk(*place) for place in x), timestep)
    data.qvel[:] = v.ravel()
    stepper, count = Stepper(model, ELASTIC, friction="ignore"), 0
    for _ in range(round(duration / timestep)):
        stepper.step(data)
        count += sum("wall" not in label for event in stepper.events for label in event.contacts.labels)
    there, exact = exact_disks(x, v, duration, size)
    assert count == exact
    assert stepper.unlocated == 0
    np.testing.assert_allclose(x + data.qpos.reshape(-1, 2), there, atol=CLOSE)


@pytest.mark.parametrize("floor", ["plane", "box"])
@pytest.mark.parametrize(
    ("speed", "timestep"), [(150.0, 0.01), (100.0 * np.pi, 0.002), (100.0 * np.pi, 0.01), (600.0, 0.01)]
)
def test_spinning_rod_strikes_the_floor_every_time(floor, speed, timestep):
    """A tip touches at an angle a, the other one at a - pi: the rod turns back and forth by 2 a."""
    shape = {"plane": 'type="plane" size="9 9 1"', "box": 'type="box" size="9 9 .5" pos="0 0 -.5"'}[floor]
    rod = '<geom type="capsule" size=".01" fromto="-.5 0 0 .5 0 0" mass="1"/>'
    world = f'<geom {shape}/><body pos="0 0 .45"><joint type="hinge" axis="0 1 0"/>{rod}</body>'
    model, data = compiled(world, timestep)
    start, touch, duration = 0.3, np.arcsin(0.44 / 0.5), 0.3
    data.qpos[0], data.qvel[0] = start, speed
    stepper, count = Stepper(model, ELASTIC, friction="ignore"), 0
    for _ in range(round(duration / timestep)):
        stepper.step(data)
        count += len(stepper.events)
    assert count == int((speed * duration - (touch - start)) / (2.0 * touch)) + 1
    assert abs(data.qvel[0]) == pytest.approx(speed)


def test_ball_thrown_at_a_ceiling_that_it_would_reach_in_the_middle_of_a_step():
    """It would rise 1e-5 m beyond the ceiling, ``g h^2 / 8 = 1.2e-4 m`` at most, and return by itself."""
    g, timestep, above = 9.81, 0.01, 1e-5
    rise = 0.5 * timestep + 3.0 * timestep  # s, time of the apex
    height = 0.5 * g * rise**2
    ceiling = f'<geom type="plane" size="9 9 1" pos="0 0 {height - above + 0.1}" zaxis="0 0 -1"/>'
    ball = '<body><joint type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>'
    model, data = compiled(ceiling + ball, timestep, gravity=f"0 0 {-g}")
    data.qvel[0] = g * rise
    stepper, events = Stepper(model, ELASTIC), []
    for _ in range(6):
        stepper.step(data)
        events += stepper.events
    assert len(events) == 1
    assert events[0].impact.collision.pre_velocity[0] == pytest.approx(np.sqrt(2.0 * g * above), rel=1e-3)


def test_contacts_of_a_step_without_a_dip_are_those_at_its_end():
    """The ball would have to rise 5e-5 m higher; the look at the start of the step leaves nothing in data.contact."""
    g, timestep = 9.81, 0.01
    rise = 0.5 * timestep + 3.0 * timestep  # s, time of the apex
    ceiling = f'<geom type="plane" size="9 9 1" pos="0 0 {0.5 * g * rise**2 + 5e-5 + 0.1}" zaxis="0 0 -1"/>'
    ball = '<body><joint type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>'
    slider = '<body pos="3 0 -.9"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><geom size=".1"/>'
    floor = '<geom type="plane" size="9 9 1" pos="0 0 -1"/>'
    model, data = compiled(f"{floor}{ceiling}{ball}{slider}</body>", timestep, gravity=f"0 0 {-g}")
    data.qvel[:] = g * rise, 1.0, 0.0
    stepper = Stepper(model, ELASTIC, friction="ignore")
    for step in range(1, 7):
        stepper.step(data)
        assert stepper.events == ()
        assert data.contact.pos[:, 0] == pytest.approx([3.0 + step * timestep])


@pytest.mark.parametrize("timestep", [0.005, 0.002])
@pytest.mark.parametrize("stop", [0.05, 0.17, 0.195])
def test_an_oscillator_that_all_but_grazes_its_stop_hits_it_once_a_period(stop, timestep):
    """In the last of these steps it moves less than it is away at their end: it comes, turns and leaves.

    A mass on a spring hits a stop (S. W. Shaw and P. J. Holmes, J. Sound Vib. 90, 1983); with e = 0.5 its amplitude
    approaches the place of the stop, m.
    """
    rate, speed, duration = 10.0, 2.0, 6.0
    mass = f'<body><joint type="slide" axis="1 0 0" stiffness="{rate**2}"/><geom size=".1" mass="1"/></body>'
    model, data = compiled(f'<geom type="box" size=".1 1 1" pos="{0.2 + stop} 0 0"/>{mass}', timestep)
    data.qvel[0] = speed
    stepper, times = Stepper(model, Moreau(0.5), friction="ignore"), []
    for _ in range(round(duration / timestep)):
        stepper.step(data)
        times += [event.time for event in stepper.events]
    time, speed, expected = np.arcsin(rate * stop / speed) / rate, np.sqrt(speed**2 - (rate * stop) ** 2), []
    while time < duration:
        expected.append(time)
        speed *= 0.5
        time += 2.0 * (np.pi - np.arctan2(speed / rate, stop)) / rate
    np.testing.assert_allclose(times, expected, atol=1e-4)
