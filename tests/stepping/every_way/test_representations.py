"""Equivalent descriptions of a scene move in the same way."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Newton, Poisson, Stepper

WAYS = {
    "event-driven": {},
    "time-stepping": {"scheme": "time-stepping"},
}
GEOMS = (
    '<geom type="box" size=".1 .08 .06" pos=".02 0 .01" mass="1"/>',
    '<geom type="capsule" size=".05 .1" pos="0 .03 0" mass="1"/>',
    '<geom type="sphere" size=".07" pos=".03 0 0" mass="1"/>',
)
BALL = '<geom type="sphere" size=".04" mass=".3"{}/>'
SLIDES = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
INSIDE = {
    "one body": "<freejoint/>{geom}" + BALL.format(' pos="0 0 .1"'),
    "slides and a ball joint": SLIDES + '<joint type="ball"/>{geom}' + BALL.format(' pos="0 0 .1"'),
    "a child without a joint": '<freejoint/>{geom}<body pos="0 0 .1">' + BALL.format("") + "</body>",
    "children of children": "<freejoint/><body>{geom}<body pos='0 0 .04'><body pos='0 0 .06'>"
    + BALL.format("")
    + "</body></body></body>",
}
PLANE = '<geom type="plane" size="5 5 1"/>'
FLOORS = {"of the world": PLANE, "a fixed body": f"<body>{PLANE}</body>", "mocap": f'<body mocap="true">{PLANE}</body>'}


def motion(way: str, law: Moreau | Newton | Poisson, inside: str, floor: str, seed: int) -> np.ndarray:
    """Return the velocities over 0.25 s in which three bodies are thrown onto a floor with friction."""
    bodies = "".join(
        f'<body pos="{0.35 * i} 0 {0.25 + 0.1 * i}">{INSIDE[inside].format(geom=geom)}</body>'
        for i, geom in enumerate(GEOMS)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep=".001"/><worldbody>{FLOORS[floor]}{bodies}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(seed).normal(size=18)
    data.qvel[2::6] -= 1.0
    stepper, velocities = Stepper(model, law, **WAYS[way]), []  # pyright: ignore[reportArgumentType]
    for _ in range(250):
        stepper.step(data)
        velocities.append(data.qvel.copy())
    return np.array(velocities)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("law", [Moreau(0.5), Newton(0.8), Poisson(0.5)], ids=str)
@pytest.mark.parametrize(
    ("inside", "floor"),
    [(inside, "of the world") for inside in list(INSIDE)[1:]] + [("one body", floor) for floor in list(FLOORS)[1:]],
)
def test_the_same_bodies_and_the_same_floor(way, law, inside, floor):
    """A child without a joint is a part of its body, and a mocap body at rest is a part of the world."""
    for seed in (0, 1):
        plain = motion(way, law, "one body", "of the world", seed)
        assert (np.abs(np.diff(plain, axis=0)) > 0.1).any()  # some bodies collide
        np.testing.assert_allclose(motion(way, law, inside, floor, seed), plain, atol=1e-8)
