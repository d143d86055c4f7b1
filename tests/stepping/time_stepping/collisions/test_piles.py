"""Piles of bodies: friction without a unique solution, and contacts that change in each step."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper

_HALF, _SPACING = (0.004, 0.012, 0.024), 0.022


def _dominoes(count: int, push: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a row of dominoes, the first one pushed over at `push` rad/s."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.default.geom.friction[0], spec.default.geom.density = 0.5, 500.0
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05])
    for i in range(count):
        body = spec.worldbody.add_body(pos=[i * _SPACING, 0.0, _HALF[2]])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=_HALF)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[[0, 2, 4]] = push * _HALF[2], push * _HALF[0], push
    return model, data


@pytest.mark.parametrize("push", [3.9, 4.0, 4.1])
def test_dominoes_that_lean_on_each_other_meet_the_law(push):
    model, data = _dominoes(16, push)
    stepper, missed = Stepper(model, Moreau(0.0), scheme="time-stepping"), []
    for _ in range(700):
        speed = max(1e-2, float(np.abs(data.qvel).max()))
        stepper.step(data)
        missed.append(stepper.shortfall / speed)
    assert data.qpos[2::7].max() < 0.6 * _HALF[2]  # all have fallen
    assert np.mean(np.array(missed) < 1e-6) > 0.99
    assert max(missed) < 5e-3


def _cylinders(seed: int, count: int = 8) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return cylinders with random orientations that fall into a pit."""
    random, spec = np.random.default_rng(seed), mujoco.MjSpec()
    spec.default.geom.density = 500.0
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        size = [0.05 + 0.2 * abs(y), 0.05 + 0.2 * abs(x), 0.2]
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0.25 * x, 0.25 * y, 0.2], size=size)
    for i in range(count):
        place = [*random.uniform(-0.08, 0.08, 2), 0.1 + 0.15 * i]
        body = spec.worldbody.add_body(pos=place, quat=random.normal(size=4))
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[*random.uniform(0.04, 0.08, 2), 0.05])
    model = spec.compile()
    return model, mujoco.MjData(model)


def _least_gap(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the least gap of `_cylinders` to the floor, in closed form, and to others; contacts of data are older.

    MuJoCo's distance of flat ends that touch can be wrong by a radius; it is not if they are moved by 1e-7 m.
    """
    pairs, other = {tuple(pair) for pair in data.contact.geom.tolist() if 0 not in pair}, mujoco.MjData(model)
    other.qpos[:] = data.qpos + 1e-7 * np.random.default_rng(0).normal(size=model.nq)
    mujoco.mj_kinematics(model, other)
    gaps = [max(mujoco.mj_geomDistance(model, d, *pair, 0.01, None) for d in (data, other)) for pair in pairs]
    up, (radius, half) = data.geom_xmat[5:, 6:], model.geom_size[5:, :2].T
    to_floor = data.geom_xpos[5:, 2] - radius * np.hypot(up[:, 0], up[:, 1]) - half * np.abs(up[:, 2])
    return min(*gaps, *to_floor)


def test_heaps_whose_contact_points_jump_come_to_rest():
    """Some 40 % of them do; in the others a cylinder rolls away or turns on two contacts. The motion is chaotic.

    In some, there are steps in which cylinders hit each other more often than the scheme follows.
    """
    at_rest, short, count, steps = 0, 0, 12, 1500
    for seed in range(count):
        model, data = _cylinders(seed)
        stepper = Stepper(model, Moreau(0.0), scheme="time-stepping")
        for _ in range(steps):
            stepper.step(data)
        assert _least_gap(model, data) > -1e-5
        at_rest += np.abs(data.qvel).max() < 1e-9
        short += stepper.short_steps
    assert at_rest >= 2
    assert short < 0.05 * count * steps


def _boxed_pile(seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return bodies of many shapes and masses that fall into a narrow box."""
    rng = np.random.default_rng(seed)
    walls = "".join(
        f'<geom type="box" size=".3 .02 .3" pos="{0.25 * x} {0.25 * y} .2" euler="0 0 {angle}"/>'
        for x, y, angle in ((1, 0, 90), (0, 1, 0), (-1, 0, 90), (0, -1, 0))
    )
    sizes = {"box": ".06 .05 .04", "sphere": ".05", "capsule": ".03 .08", "cylinder": ".05 .04"}
    bodies = ""
    for i in range(8):
        shape, (x, y), (a, b) = rng.choice(list(sizes)), rng.uniform(-0.1, 0.1, 2), rng.uniform(0, 90, 2)
        bodies += f"""<body pos="{x} {y} {0.08 + 0.11 * i}" euler="{a} {b} 0"><freejoint/>
            <geom type="{shape}" size="{sizes[shape]}" mass="{10 ** rng.uniform(-2, 1)}"/></body>"""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="5e-3"/>
        <default><geom condim="6" friction="3 .01 .001"/></default>
        <worldbody><geom type="plane" size="2 2 .1"/>{walls}{bodies}</worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:] = 0.5 * rng.normal(size=model.nv)
    return model, data


def test_steps_whose_friction_is_not_found_are_counted():
    """Large friction jams bodies between walls: normal velocities reach their targets, but sliding ones do not."""
    model, data = _boxed_pile(6)
    stepper, missed = Stepper(model, Moreau(0.0), scheme="time-stepping"), 0.0
    for _ in range(90):
        stepper.step(data)
        missed = max(missed, stepper.shortfall)
    assert missed < 1e-8  # m/s, up to which no shortfall counts
    assert stepper.short_steps > 2
