"""Hard cases of rigid stepping: invalid states, changes between steps, edges, stiff actuators."""

import math
from functools import partial

import mujoco
import numpy as np
import pytest
import scenes

from impactlaw import MaximalDissipation, Moreau, Newton, Stepper
from impactlaw.errors import (
    DivergenceError,
    ImpactLawError,
    SceneError,
)
from impactlaw.models import load

FLOOR = '<geom name="floor" type="plane" size="1 1 1" condim="1"/>'
compiled = partial(scenes.compiled, option='timestep="0.01" gravity="0 0 0"')


def ball(name="ball", pos="0 0 1", size="0.1", condim=1):
    return f'<body name="{name}" pos="{pos}"><freejoint/><geom name="{name}" size="{size}" condim="{condim}"/></body>'


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_broken_state_is_an_error_and_no_silent_reset(value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning to a file there
    model, data = compiled(FLOOR + ball())
    data.time = 1.0
    data.qvel[0] = value
    stepper = Stepper(model, Moreau(1))
    with pytest.raises(DivergenceError, match="not finite"):
        stepper.step(data)
    assert data.time == 1.0
    assert not np.isfinite(data.qvel[0])


@pytest.mark.parametrize(
    ("field", "options"),
    [("body_mass", {}), ("body_mass", {"on_unsolved": "raise"}), ("geom_size", {"on_unsolved": "raise"})],
)
def test_a_model_that_is_not_finite_any_more_is_an_error(field, options, tmp_path, monkeypatch):
    """Overlap should be pushed out, which needs inertia and gaps."""
    monkeypatch.chdir(tmp_path)
    model, data = compiled(FLOOR + ball(pos="0 0 .09") + ball("other", pos="0 0 .26"))
    stepper = Stepper(model, Moreau(0.5), overlap="push-out", **options)
    getattr(model, field)[-1] = math.nan
    with pytest.raises(DivergenceError, match="not finite"):
        stepper.step(data)


def test_options_of_the_model_survive_an_error():
    model, data = compiled(FLOOR + ball(pos="0 0 .05"))

    def options():
        opt = model.opt
        return opt.timestep, opt.disableflags, opt.enableflags, opt.o_margin, opt.ccd_tolerance, opt.ccd_iterations

    before = options()
    with pytest.raises(ImpactLawError):
        Stepper(model, Moreau(1)).step(data)
    assert options() == before


def test_same_start_same_result_also_from_a_saved_state():
    model, data = load("billiard_rack")
    stepper = Stepper(model, Moreau(0.9))
    for _ in range(100):
        stepper.step(data)
    middle = data.qpos.copy(), data.qvel.copy(), data.time
    for _ in range(100):
        stepper.step(data)
    again = mujoco.MjData(model)
    again.qpos[:], again.qvel[:], again.time = middle
    fresh = Stepper(model, Moreau(0.9))
    for _ in range(100):
        fresh.step(again)
    assert (again.qpos == data.qpos).all()
    assert (again.qvel == data.qvel).all()


def test_options_may_change_between_steps():
    model, data = compiled(FLOOR + ball(pos="0 0 5"), option='timestep="0.01" integrator="RK4"')
    stepper = Stepper(model, Moreau(1))
    stepper.step(data)
    model.opt.timestep, model.opt.gravity[2] = 0.02, -1.0
    stepper.step(data)
    assert data.time == pytest.approx(0.03)
    assert data.qvel[2] == pytest.approx(-0.0981 - 0.02)


def test_a_motor_pushes_a_block_against_a_wall_and_it_stays():
    world = """<geom name="wall" type="box" size=".1 1 1" pos="1 0 0" condim="1"/>
        <body><joint name="x" type="slide" axis="1 0 0"/>
        <geom name="block" type="box" size=".1 .1 .1" condim="1" mass="1"/></body>"""
    rest = '<actuator><motor joint="x"/></actuator>'
    for integrator in ("Euler", "implicitfast", "RK4"):
        model, data = compiled(world, rest, option=f'timestep="0.01" integrator="{integrator}"')
        data.ctrl[0] = 10.0
        stepper = Stepper(model, Moreau(0.3))
        for _ in range(300):
            stepper.step(data)
        assert data.qpos[0] == pytest.approx(0.8, abs=1e-9)
        assert abs(data.qvel[0]) < 1e-9
        data.ctrl[0] = -10.0
        stepper.step(data)
        assert data.qvel[0] == pytest.approx(-0.1, rel=1e-6)


def test_the_pairs_the_stepper_expects_are_those_mujoco_reports():
    from impactlaw.scene.pairs import geom_pairs

    world = """<geom name="floor" type="plane" size="1 1 1" condim="1"/>
      <body name="a" pos="0 0 0"><freejoint/><geom name="a" size=".5" condim="1"/>
        <body name="b"><joint type="hinge"/><geom name="b" size=".5" condim="1"/>
          <body name="c"><joint type="hinge"/><geom name="c" size=".5" condim="1"/>
            <body name="d"><geom name="d" size=".5" condim="1"/></body></body></body></body>
      <body name="e"><freejoint/><geom name="e" size=".5" contype="2" conaffinity="0" condim="1"/></body>
      <body name="f"><freejoint/><geom name="f" size=".5" contype="0" conaffinity="2" condim="1"/></body>
      <body name="g"><freejoint/><geom name="g" size=".5" contype="0" conaffinity="0" condim="1"/></body>"""
    rest = """<contact><exclude body1="a" body2="c"/><pair geom1="g" geom2="a" condim="1"/></contact>"""
    model, data = compiled(world, rest=rest)
    mujoco.mj_forward(model, data)
    reported = {tuple(sorted(contact.geom.tolist())) for contact in data.contact}
    assert {tuple(pair) for pair in geom_pairs(model).geoms.tolist()} == reported


@pytest.mark.parametrize(("size", "per_fall"), [(1.0, 7), (1.0, 10), (1000.0, 12)])
def test_a_box_that_rolls_over_its_edges_gains_no_energy_at_large_timesteps(size, per_fall):
    """Held corners are pushed out farther than contacts are detected, and other corners come near meanwhile."""
    timestep = math.sqrt(2 * size / 9.81) / per_fall
    box = f"""<body pos="0 0 {3 * size}" euler="20 30 40"><freejoint/>
        <geom type="box" size="{size} {size} {size}" mass="1" condim="1"/></body>"""
    model, data = compiled(FLOOR + box, option=f'timestep="{timestep!r}" integrator="RK4" gravity="0 0 -9.81"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    stepper = Stepper(model, MaximalDissipation(), gap_tolerance=1e-9 * size)
    energies = []
    for _ in range(6 * per_fall):
        stepper.step(data)
        mujoco.mj_forward(model, data)
        energies.append(data.energy.sum() / (9.81 * size))
    gain = np.maximum.accumulate(np.array(energies)[::-1])[::-1] - energies
    assert gain.max() < 1e-5
    assert energies[-1] == pytest.approx(1.0, abs=1e-6)  # flat on the floor


def test_a_stack_of_boxes_1000_times_as_heavy_as_those_between_them_stays():
    """Only rounding moves it: without friction, the smallest tilt grows up to tenfold in each step."""
    boxes = "".join(
        f'<body pos="0 0 {0.125 + 0.25 * i}"><freejoint/>'
        f'<geom type="box" size=".125 .125 .125" mass="{1000 ** (i % 2)}" condim="1"/></body>'
        for i in range(50)
    )
    model, data = scenes.compiled(FLOOR + boxes)
    start, stepper = data.qpos.copy(), Stepper(model, MaximalDissipation())
    for _ in range(6):
        stepper.step(data)
    np.testing.assert_allclose(data.qpos, start, atol=2e-11)


@pytest.mark.parametrize("timestep", [1e-3, 1e-2])
def test_a_stiff_actuator_leaves_no_step_in_penetration(timestep):
    """A rebound that is rest only for short phases must not leave the block inside the wall."""
    world = """<geom name="wall" type="box" size=".1 1 1" pos="1 0 0" condim="1"/>
        <body><joint name="x" type="slide" axis="1 0 0"/>
        <geom name="block" type="box" size=".1 .1 .1" condim="1" mass="1"/></body>"""
    rest = '<actuator><position joint="x" kp="1e6" dampratio="1"/></actuator>'
    model, data = compiled(world, rest, option=f'timestep="{timestep}" integrator="RK4" gravity="0 0 0"')
    data.ctrl[0] = 0.9
    stepper = Stepper(model, Newton(0.3))
    for _ in range(8):
        stepper.step(data)
        assert data.qpos[0] <= 0.8 + 1e-9
    assert data.qpos[0] == pytest.approx(0.8, abs=1e-9)
    assert abs(data.qvel[0]) < 1e-9


@pytest.mark.parametrize(("size", "least"), [("1.2e6", "2e-09"), ("9.4e6", "1e-08"), ("9.6e6", "1e-08")])
def test_the_least_gap_tolerance_that_is_advised_is_taken(size, least):
    model, _ = compiled(FLOOR + ball(pos=f"0 0 {size}", size=size))
    with pytest.raises(SceneError, match=f"or at least {least}"):
        Stepper(model, Moreau(1))
    Stepper(model, Moreau(1), gap_tolerance=float(least))


def test_a_gap_tolerance_below_the_rounding_of_positions_is_refused():
    model, data = compiled(FLOOR + ball(pos="0 0 2e6", size="1e6"))
    with pytest.raises(SceneError, match=r"tolerance of 1e-09 m is below the rounding.*pass gap_tolerance=2e-03"):
        Stepper(model, Moreau(1))
    data.qvel[2] = -2e8
    Stepper(model, Moreau(1), gap_tolerance=1e-3).step(data)
    assert [data.qpos[2], data.qvel[2]] == pytest.approx([2e6, 2e8], rel=1e-9)
