"""The cases of the stability study that step a few bodies whose motion is known in closed form."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from .verdicts import REFUSED, Case, Expected, Measurement, stepped
from .watch import FLOOR, G, Watch, bounce, coefficient, compiled

LAWS = ("maximal-dissipation", "moreau 0.5", "moreau 1", "newton 0.3")


def _body(name: str, pos: tuple[float, ...], joint: str, kind: str, size: float, euler: str = "0 0 0") -> str:
    """Return a ball or cube of mass 1, with explicit inertia, as MuJoCo finds none for volumes below 1e-15 m^3."""
    inertia = (0.4 if kind == "sphere" else 2.0 / 3.0) * size**2
    at, sizes = " ".join(f"{x:.17g}" for x in pos), " ".join([f"{size:.17g}"] * 3)
    return f"""<body pos="{at}" euler="{euler}">{joint}
        <inertial pos="0 0 0" mass="1" diaginertia="{inertia:.17g} {inertia:.17g} {inertia:.17g}"/>
        <geom name="{name}" type="{kind}" size="{sizes}" condim="1"/></body>"""


def _slide(*axes: str) -> str:
    return "".join(f'<joint type="slide" axis="{axis}"/>' for axis in axes)


def _ball(size: float, height: float) -> str:
    return FLOOR + _body("ball", (0.0, 0.0, size + height), _slide("0 0 1"), "sphere", size)


def _bounce(
    size: float, height: float, timestep: float, steps: int, tolerance: float, law: str, unit: float
) -> Measurement:
    """Drop a ball; deviation of its height from the closed form, in the given unit of length."""
    watch = Watch(compiled(_ball(size, height), timestep=timestep), law, gap_tolerance=tolerance)
    start = watch.model.body_pos[1, 2] - size
    for _ in range(steps):
        watch.step()
        expected = bounce(watch.data.time, coefficient(law), start, G)
        watch.deviates(abs(start + watch.data.qpos[0] - expected) / unit)
    return watch.measurement(energy_scale=G * height)


def _dropped_ball(size: float, scaled: bool, law: str, quick: bool) -> Measurement:
    """Drop a ball from a height of its own radius; seven timesteps per fall, for four times the time of the fall."""
    timestep = float(np.sqrt(2.0 * size / G)) / 7.0
    return _bounce(size, size, timestep, 28, 1e-9 * (size if scaled else 1.0), law, unit=size)


def _small_steps(timestep: float, law: str, quick: bool) -> Measurement:
    duration = min(2.0, (500 if quick else 2000) * timestep)
    height = min(1.0, 0.5 * G * (duration / 2.5) ** 2)
    return _bounce(0.1, height, timestep, max(20, round(duration / timestep)), 1e-9, law, unit=1.0)


def _dropped_box(size: float, scaled: bool, steps: int, law: str, quick: bool) -> Measurement:
    """Drop a tilted box from a height of its own size and let it tumble; energy is relative to that of the drop."""
    timestep = float(np.sqrt(2.0 * size / G)) / steps
    world = FLOOR + _body("box", (0.0, 0.0, 3.0 * size), "<freejoint/>", "box", size, "20 30 40")
    tolerance = 1e-9 * (size if scaled else 1.0)
    watch = Watch(compiled(world, timestep=timestep), law, gap_tolerance=tolerance, size=size)
    before = watch.seen().energy
    watch.step(6 * steps)
    energy = abs(watch.seen().energy - before) / (G * size) if law == "moreau 1" else None
    return watch.measurement(energy=energy, energy_scale=G * size)


def _collapse(law: str, quick: bool) -> Measurement:
    """Let three equal balls meet on a line; deviation of their positions, m, from a sequence of exact collisions."""
    gap, velocity = np.array([0.25, 0.5]), np.array([1.0, 0.125, -1.0])
    radius, at = 0.125, np.array([0.0, 0.5, 1.25])
    world = "".join(_body(f"b{i}", (x, 0.0, 0.0), _slide("1 0 0"), "sphere", radius) for i, x in enumerate(at))
    watch = Watch(compiled(world, timestep=0.05, gravity=0.0, integrator="Euler"), law)
    watch.data.qvel[:] = velocity
    expected = _exact_line(gap, velocity, coefficient(law), watch.model.opt.timestep, 40)
    for row in expected:
        watch.step()
        watch.deviates(float(np.abs(at + watch.data.qpos - row).max()))
    return watch.measurement(energy_scale=0.5 * float(velocity @ velocity))


def _exact_line(gap: np.ndarray, velocity: np.ndarray, e: float, timestep: float, steps: int) -> list[np.ndarray]:
    """Return the positions of three equal balls of diameter 1/4 after each timestep, by one collision after another.

    Once relative velocities are below 1e-13 the balls move on together: infinitely many collisions are over.
    """
    at, v, time, found = np.array([0.0, 0.25 + gap[0], 0.5 + gap.sum()]), velocity.copy(), 0.0, []
    for step in range(1, steps + 1):
        while True:
            apart, closing = np.diff(at) - 0.25, -np.diff(v)
            if np.abs(closing).max() < 1e-13:
                v[:] = v.mean()
            wait = np.array([max(a, 0.0) / c if c > 1e-14 else np.inf for a, c in zip(apart, closing, strict=True)])
            first = int(np.argmin(wait))
            if time + wait[first] > step * timestep:
                break
            at += v * wait[first]
            time += wait[first]
            push = 0.5 * (1.0 + e) * closing[first]
            v[first] -= push
            v[first + 1] += push
        at = at + v * (step * timestep - time)
        time = step * timestep
        found.append(at.copy())
    return found


def _slope(timestep: float, law: str, quick: bool) -> Measurement:
    """Let a ball bounce down a slope of 30 degrees; deviation from the closed form along and across it, m."""
    radius, height = 0.1, 0.5
    along, across = np.array([np.sqrt(3) / 2, -0.5]), np.array([0.5, np.sqrt(3) / 2])
    start = (radius + height) * across
    world = '<geom name="slope" type="plane" size="1 1 1" euler="0 30 0" condim="1"/>'
    world += _body("ball", (start[0], 0.0, start[1]), _slide("1 0 0", "0 0 1"), "sphere", radius)
    watch = Watch(compiled(world, timestep=timestep), law)
    for _ in range(round(2.0 / timestep)):
        watch.step()
        t, q = watch.data.time, watch.data.qpos
        gap = bounce(t, coefficient(law), height, G * across[1])
        watch.deviates(float(np.hypot(q @ across + height - gap, q @ along - 0.25 * G * t * t)))
    return watch.measurement(energy_scale=G * height)


def _elastic(law: str, quick: bool) -> Measurement:
    """Let a ball bounce elastically; energy is its largest drift relative to the energy of the drop."""
    height, size, timestep = 1.0, 0.1, 1e-3
    watch = Watch(compiled(_ball(size, height), timestep=timestep), law, every=1000)
    q, v, drift = watch.data.qpos, watch.data.qvel, 0.0
    for _ in range(5_000 if quick else 1_000_000):
        watch.step()
        drift = max(drift, abs(G * q[0] + 0.5 * v[0] ** 2))
        watch.penetration = max(watch.penetration, -height - q[0])
    return watch.measurement(energy=drift / (G * height))


def _drops() -> Iterator[Case]:
    refused = Expected(REFUSED, "the gap tolerance is below the rounding of positions", "SceneError: a gap tolerance")
    for power in (-6, -3, 0, 3, 6):
        size = 10.0**power
        for scaled in (False, True) if power else (False,):
            tolerance = 1e-9 * (size if scaled else 1.0)
            rules = (refused,) if power == 6 and not scaled else ()
            name = f"of 1e{power:+d} m, gap tolerance {tolerance:g} m"
            rest = max(2.0 * tolerance / size, 1e-8)  # a rebound below the gap tolerance counts as rest
            ball, limits = partial(_dropped_ball, size, scaled), {"energy": 1e-8, "penetration": tolerance}
            yield stepped(f"bouncing ball {name}", ball, LAWS, *rules, **limits, deviation=rest)
            # time stepping takes the steps with more collisions than max_events
            energy = 1e-2 if tolerance < 1e-11 * size else 1e-5
            for steps in (25, 12):
                box = partial(_dropped_box, size, scaled, steps)
                title = f"tumbling box {name}, {steps} steps per fall"
                # in these, contacts slower than g h do not bounce: 0.5 g h is missed, relative to the speed of the fall
                slow = 0.5 / steps
                yield stepped(title, box, LAWS, *rules, energy=energy, penetration=tolerance, first_order=slow)


def cases() -> Iterator[Case]:
    """Yield the cases of few bodies."""
    yield from _drops()
    for power in range(-6, 0):
        energy = max(1e-8, 1e-8 * 10.0 ** (-8 - 2 * power))
        small = partial(_small_steps, 10.0**power)
        yield stepped(f"bouncing ball, timestep 1e{power}", small, LAWS, energy=energy, deviation=2e-9)
    laws = ("maximal-dissipation", "moreau 0.02", "moreau 0.05", "newton 0.07", "moreau 0.08", "moreau 0.5")
    yield stepped("inelastic collapse of three balls", _collapse, laws, deviation=1e-8)
    for timestep in (0.1, 0.01):
        name = f"Zeno on a slope, timestep {timestep:g}"
        yield stepped(name, partial(_slope, timestep), LAWS, energy=1e-8, deviation=1e-7)
    yield stepped("elastic ball, 1e6 steps", _elastic, ("moreau 1",), budget=1800.0)
