"""The cases of the stability study with many bodies, stiff forces, thin bodies and changing contacts."""

from collections.abc import Iterator
from functools import partial
from typing import Literal

import numpy as np

from impactlaw.models import builder

from .stepping import LAWS
from .verdicts import REFUSED, Case, Expected, Measurement, stepped
from .watch import FLOOR, G, Watch, coefficient, compiled

# --- stacks ----------------------------------------------------------------------------------------------------------


def _stack(n: int, ratio: float, law: str, quick: bool) -> Measurement:
    """Leave a stack of free boxes at rest; deviation is the farthest that a box moves, m."""
    world = FLOOR + "".join(
        f'<body pos="0 0 {0.125 + 0.25 * i}"><freejoint/><geom name="box{i}" type="box" size=".125 .125 .125" '
        f'mass="{ratio ** (i % 2)}" condim="1"/></body>'
        for i in range(n)
    )
    watch = Watch(compiled(world), law)
    watch.rest((1 if n > 50 else 3) if quick and n > 10 else 10 if ratio == 1 else 6)  # rounding grows tenfold a step
    return watch.measurement(energy_scale=G * n * n / 8)


def _dropped_stack(n: int, law: str, quick: bool) -> Measurement:
    """Drop a column of touching balls; deviation is the velocity left, m/s, under the law that must leave none."""
    model = builder.stack(n, drop=0.05, radius=0.125).compile()
    watch = Watch(model, law)
    watch.step(40 if quick else 400)
    if law == "maximal-dissipation":
        watch.deviates(float(np.abs(watch.data.qvel).max()))
    return watch.measurement(energy_scale=G * n * 0.05)


# --- stiff forces ----------------------------------------------------------------------------------------------------


def _actuator(integrator: str, timestep: float, law: str, quick: bool) -> Measurement:
    """Drive a block against a wall by a position actuator of kp = 1e6 N/m whose target lies 0.1 m inside the wall.

    The block must rest at the wall; deviation is its distance, m, or its velocity, m/s.
    """
    world = """<geom name="wall" type="box" size=".1 1 1" pos="1 0 0" condim="1"/>
        <body><joint name="x" type="slide" axis="1 0 0"/>
        <geom name="block" type="box" size=".1 .1 .1" condim="1" mass="1"/></body>"""
    rest = '<actuator><position joint="x" kp="1e6" dampratio="1"/></actuator>'
    watch = Watch(compiled(world, rest, timestep=timestep, gravity=0.0, integrator=integrator), law)
    watch.data.ctrl[0] = 0.9
    watch.step(round(0.03 / timestep) + 7 if quick else round(0.1 / timestep) + 40)
    watch.deviates(abs(watch.data.qpos[0] - 0.8))
    watch.deviates(abs(watch.data.qvel[0]))
    return watch.measurement(energy=0.0, note="driven: energy of collisions only")


def _equality(kind: str, stiffness: str, contact_model: Literal["rigid", "soft"], law: str, quick: bool) -> Measurement:
    """Drop two balls that a stiff equality constraint holds together; deviation is how far the constraint gives, m."""
    equality = {
        "weld": f'<weld body1="a" body2="b" solref="{stiffness}"/>',
        "connect": f'<connect body1="a" body2="b" anchor=".15 0 0" solref="{stiffness}"/>',
    }[kind]
    world = FLOOR + "".join(
        f'<body name="{name}" pos="{x} 0 {z}"><freejoint/><geom name="{name}" size=".1" mass="1" condim="1"/></body>'
        for name, x, z in (("a", 0.0, 0.3), ("b", 0.3, 0.5))
    )
    model = compiled(world, f"<equality>{equality}</equality>", timestep=1e-3, integrator="Euler")
    watch = Watch(model, law, contact_model=contact_model)
    apart = np.linalg.norm(watch.data.qpos[7:10] - watch.data.qpos[:3])
    for _ in range(300 if quick else 1000):
        watch.step()
        if kind == "weld":
            watch.deviates(abs(float(np.linalg.norm(watch.data.qpos[7:10] - watch.data.qpos[:3]) - apart)))
        else:
            watch.deviates(watch.equality_error())
    return watch.measurement(energy_scale=2 * G * 0.3)


# --- thin and fast ---------------------------------------------------------------------------------------------------


def _plate(half: float, kind: str, law: str, quick: bool) -> Measurement:
    """Let a ball of 5 mm hit a plate at 1 km/s with a timestep of 10 ms; deviation from the closed form in m."""
    speed, radius, start = 1000.0, 0.005, 0.6
    corners = " ".join(f"{x} {y} {z}" for x in (-1, 1) for y in (-1, 1) for z in (-half, half))
    rest = f'<asset><mesh name="slab" vertex="{corners}"/></asset>' if kind == "mesh" else ""
    shape = 'type="mesh" mesh="slab"' if kind == "mesh" else f'type="box" size="1 1 {half}"'
    world = f"""<geom name="plate" {shape} condim="1"/><body pos=".13 .17 {start}"><freejoint/>
        <geom name="ball" size="{radius}" condim="1"/></body>"""
    watch = Watch(compiled(world, rest, timestep=0.01, gravity=0.0, integrator="Euler"), law)
    watch.data.qvel[2] = -speed
    watch.step(1)
    hit = (start - radius - half) / speed
    expected = radius + half + coefficient(law) * speed * (watch.data.time - hit)
    watch.deviates(abs(watch.data.qpos[2] - expected))
    return watch.measurement(energy_scale=0.5 * watch.model.body_mass[1] * speed**2)


# --- contact sets that change at every step --------------------------------------------------------------------------


def _sphere_points(n: int) -> str:
    k = np.arange(n) + 0.5
    polar, turn = np.arccos(1 - 2 * k / n), np.pi * (1 + 5**0.5) * k
    points = 0.1 * np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    return " ".join(f"{x:.6f}" for x in points.ravel())


def _land(shape: str, hills: bool, law: str, quick: bool) -> Measurement:
    """Throw a body onto a height field at 1 m/s, over hills with a spin of 10 rad/s, and step it for 0.6 s."""
    x, y = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21))
    heights = 0.5 + 0.5 * np.sin(9 * x) * np.sin(8 * y) if hills else np.zeros_like(x)
    values = " ".join(f"{z:.6f}" for z in heights.ravel())
    box = " ".join(f"{a} {b} {c}" for a in (-0.1, 0.1) for b in (-0.1, 0.1) for c in (-0.1, 0.1))
    geom = {
        "round mesh": 'type="mesh" mesh="round"',
        "box mesh": 'type="mesh" mesh="box"',
        "box": 'type="box" size=".1 .1 .1"',
        "cylinder": 'type="cylinder" size=".1 .1"',
    }[shape]
    rest = f"""<asset><mesh name="round" vertex="{_sphere_points(42)}"/><mesh name="box" vertex="{box}"/>
        <hfield name="land" nrow="21" ncol="21" size="2 2 .05 .1" elevation="{values}"/></asset>"""
    world = f"""<geom name="land" type="hfield" hfield="land" condim="1"/><body pos="-1 .1 .2"><freejoint/>
        <geom name="body" {geom} condim="1" mass="1"/></body>"""
    watch = Watch(compiled(world, rest), law)
    watch.data.qvel[:] = 1.0, 0.2, 0.0, 0.0, 10.0 if hills else 0.0, 0.0
    watch.step(100 if quick else 300)
    return watch.measurement(energy_scale=0.5 + G * 0.2, note=f"slowest step {1e3 * watch.slowest:.0f} ms")


# --- the cases -------------------------------------------------------------------------------------------------------


def cases() -> list[Case]:
    """Return the cases of stacks, stiff forces, thin plates and height fields."""
    return [*_stacks(), *_stiff(), *_plates(), *_lands()]


def _stacks() -> Iterator[Case]:
    for n in (10, 50, 200):
        for ratio in (1, 1000) if n < 200 else (1,):
            laws = ("maximal-dissipation", "moreau 1") if n < 200 else ("moreau 1",)
            name = f"stack of {n} boxes at rest, mass ratio {ratio}"
            yield stepped(name, partial(_stack, n, ratio), laws, deviation=2e-9)
        yield stepped(f"dropped column of {n} balls", partial(_dropped_stack, n), LAWS, energy=1e-6)


def _stiff() -> Iterator[Case]:
    for integrator in ("Euler", "implicitfast", "RK4"):
        for timestep in (1e-4, 1e-3, 1e-2):
            name = f"position actuator kp 1e6, {integrator}, {timestep:g} s"
            yield stepped(name, partial(_actuator, integrator, timestep), LAWS)
    reason = "stiffer than MuJoCo integrates at this timestep: mj_step alone resets itself too"
    unstable = Expected(REFUSED, reason, "DivergenceError")
    for kind in ("weld", "connect"):
        measure = partial(_equality, kind, "-1e5 -600", "rigid")
        # MuJoCo's constraints give; a constraint that moves does work in a collision, as a moving surface does.
        yield stepped(f"stiff {kind} during impact, rigid", measure, LAWS, energy=2e-2, deviation=1e-3)
        for stiffness, rules in (("-1e5 -600", ()), ("0.002 1", ()), ("-1e6 -2000", (unstable,))):
            soft = partial(_equality, kind, stiffness, "soft")
            name = f"stiff {kind} during impact, soft, solref {stiffness}"
            yield stepped(name, soft, LAWS, *rules, energy=2e-2, penetration=5e-3, deviation=5e-3)


def _plates() -> Iterator[Case]:
    for half in (5e-3, 5e-4, 5e-5):
        for kind, deviation in (("box", 1e-7), ("mesh", 1e-5)):
            name = f"plate of {2e3 * half:g} mm ({kind}) hit at 1 km/s"
            yield stepped(name, partial(_plate, half, kind), LAWS, deviation=deviation)


def _lands() -> Iterator[Case]:
    laws = ("maximal-dissipation", "moreau 0.5", "moreau 1")
    for shape in ("round mesh", "box mesh", "box", "cylinder"):
        for hills in (True, False):
            name = f"{shape} {'over a hilly' if hills else 'on a flat'} height field"
            # where contacts jump a body tips for one step: energy is of first order, depth is its fall during 2 ms
            yield stepped(name, partial(_land, shape, hills), laws, energy=2e-3, first_order=5e-3)
