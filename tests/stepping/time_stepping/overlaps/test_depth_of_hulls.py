"""Convex shapes do not overlap at the end of a step, where MuJoCo's several points of contact miss the nearest one."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_DEPTH = 1e-5  # m
_ANGLES = np.arange(12) * np.pi / 6
_COIN = " ".join(f"{0.1 * np.cos(a):.6f} {0.1 * np.sin(a):.6f} {z}" for z in (-0.02, 0.02) for a in _ANGLES)
_SHAPES = {
    "prism": 'type="mesh" mesh="coin" mass="1"',
    "cylinder": 'type="cylinder" size=".1 .02" mass="1"',
    "capsule": 'type="capsule" size=".04 .1" mass="1"',
    "box": 'type="box" size=".1 .08 .03" mass="1"',
}
_SLAB = " ".join(f"{x} {y} {z}" for x in (-3, 3) for y in (-3, 3) for z in (-0.5, 0.5))
_FLOORS = {
    "plane": 'type="plane" size="9 9 1"',
    "box": 'type="box" size="3 3 .5" pos="0 0 -.5"',
    "mesh": 'type="mesh" mesh="slab" pos="0 0 -.5"',
}


def _model(floor: str, bodies: str, timestep: float = 0.004) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/>
        <asset><mesh name="coin" vertex="{_COIN}"/><mesh name="slab" vertex="{_SLAB}"/></asset>
        <worldbody><geom {_FLOORS[floor]}/>{bodies}</worldbody></mujoco>"""
    )


def _depths(model: mujoco.MjModel, data: mujoco.MjData, stepper: Stepper, steps: int) -> np.ndarray:
    """Return the depth of the overlap at the end of each step, m, at the nearest points of bodies."""
    exact, depths = copy.copy(model), np.zeros(steps)
    exact.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
    exact.opt.ccd_tolerance, exact.opt.ccd_iterations = 1e-10, 100
    seen = mujoco.MjData(exact)
    for step in range(steps):
        stepper.step(data)
        seen.qpos[:] = data.qpos
        mujoco.mj_fwdPosition(exact, seen)
        depths[step] = -seen.contact.dist.min(initial=0.0)
    return depths


@pytest.mark.parametrize(
    ("first", "second"), [("box", "prism"), ("mesh", "prism"), ("box", "cylinder"), ("mesh", "cylinder")]
)
def test_face_that_stands_on_another_one_a_little_tilted_does_not_sink_in(first, second):
    """MuJoCo keeps four corners of the common face, among them not the lowest one."""
    tilted = f'<body pos="0 0 .05" euler=".2 .1 20"><joint type="slide" axis="0 0 1"/><geom {_SHAPES[second]}/></body>'
    model = _model(first, tilted)
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
    depths = _depths(model, data, stepper, 100)
    assert abs(data.qvel[0]) < 1e-9
    assert depths.max() <= _DEPTH


def _thrown(floor: str, shapes: tuple[str, ...], seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return bodies that turn fast when they land, and hit each other."""
    rng, bodies = np.random.default_rng(seed), ""
    for i, shape in enumerate(shapes):
        place, turn = rng.normal(0.0, 0.1, 2), rng.uniform(0.0, 360.0, 2)
        bodies += f'<body pos="{place[0]} {place[1]} {0.3 + 0.25 * i}" euler="{turn[0]} {turn[1]} 0"><freejoint/>'
        bodies += f"<geom {_SHAPES[shape]}/></body>"
    model = _model(floor, bodies)
    data = mujoco.MjData(model)
    data.qvel[:] = rng.normal(0.0, 3.0, model.nv)
    return model, data


@pytest.mark.parametrize(
    ("floor", "shapes", "seed"),
    [
        ("plane", ("prism", "prism"), 7),
        ("box", ("prism", "prism", "prism"), 6),
        ("box", ("cylinder", "cylinder", "cylinder", "cylinder"), 7),
        ("mesh", ("capsule", "capsule"), 5),
        ("mesh", ("prism", "box"), 7),
    ],
)
def test_thrown_shapes_do_not_overlap(floor, shapes, seed):
    """Their contacts jump from corner to corner within a step."""
    model, data = _thrown(floor, shapes, seed)
    stepper = Stepper(model, Moreau(0.3), scheme="time-stepping")
    assert _depths(model, data, stepper, 200).max() <= _DEPTH


def test_steps_that_leave_an_overlap_are_counted():
    """The inner sides of the prisms of a rough height field push cylinders, so that not all overlaps can be opened."""
    rng, bodies = np.random.default_rng(0), ""
    for i in range(4):
        x, y, *angles = *rng.normal(0.0, 0.12, 2), *rng.uniform(0.0, 360.0, 2)
        bodies += f'<body pos="{x} {y} {0.3 + 0.25 * i}" euler="{angles[0]} {angles[1]} 0"><freejoint/>'
        bodies += '<geom type="cylinder" size=".06 .1" mass="1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".005"/>
        <asset><hfield name="rough" nrow="20" ncol="20" size="3 3 .15 .1"/></asset>
        <worldbody><geom type="hfield" hfield="rough"/>{bodies}</worldbody></mujoco>"""
    )
    model.hfield_data[:] = rng.uniform(0.0, 1.0, 400)
    data = mujoco.MjData(model)
    data.qvel[:] = rng.normal(0.0, 3.0, model.nv)
    stepper, deep, counted = Stepper(model, Moreau(0.0), scheme="time-stepping"), [], []
    for _ in range(300):
        before = stepper.short_steps
        deep.append(_depths(model, data, stepper, 1)[0] > 1.01 * _DEPTH)
        counted.append(stepper.short_steps > before)
    assert sum(deep) >= 5
    assert np.all(np.array(counted)[deep])
