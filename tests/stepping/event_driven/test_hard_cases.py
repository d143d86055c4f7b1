"""Where rigid stepping is hard: fast thin bodies, wrong starts, refused scenes, wrong laws, broken states."""

import math
from functools import partial

import mujoco
import numpy as np
import pytest
import scenes
from scenes import mass_matrix, run

from impactlaw import Fremond, MaximalDissipation, Moreau, Newton, Stepper, read_contacts
from impactlaw.errors import (
    DivergenceError,
    ImpactLawError,
    InadmissibleImpactError,
    OverlapError,
    RestitutionError,
    SceneError,
    UnknownNameError,
)
from impactlaw.models import load

FLOOR = '<geom name="floor" type="plane" size="1 1 1" condim="1"/>'


compiled = partial(scenes.compiled, option='timestep="0.01" gravity="0 0 0"')


def ball(name="ball", pos="0 0 1", size="0.1", condim=1):
    return f'<body name="{name}" pos="{pos}"><freejoint/><geom name="{name}" size="{size}" condim="{condim}"/></body>'


@pytest.mark.parametrize("speed", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("half", [0.005, 0.0005])
def test_a_fast_small_ball_does_not_pass_a_thin_plate(speed, half):
    plate = f'<geom name="plate" type="box" size="1 1 {half}" condim="1"/>'
    model, data = compiled(plate + ball(pos="0.1 0.2 0.6", size="0.005"))
    data.qvel[2] = -speed
    events = run(Stepper(model, Moreau(1)), data, math.ceil(1.2 / (speed * 0.01)))
    assert len(events) == 1
    touch = 0.005 + half
    assert events[0].time == pytest.approx((0.6 - touch) / speed, abs=1e-9 / speed * 10)
    assert data.qpos[2] == pytest.approx(2 * touch - 0.6 + speed * data.time, abs=1e-8)


def test_two_fast_balls_meet():
    model, data = compiled(ball("left", "-5 0 0", ".01") + ball("right", "5 0 0", ".01"))
    data.qvel[0], data.qvel[6] = 300.0, -700.0
    stepper = Stepper(model, Moreau(1))
    for _ in range(3):
        stepper.step(data)
    assert [data.qvel[0], data.qvel[6]] == pytest.approx([-700.0, 300.0])


def test_a_fast_ball_is_stopped_by_a_mesh_and_by_a_height_field():
    corners = " ".join(f"{x} {y} {z}" for x in (-1, 1) for y in (-1, 1) for z in (-0.01, 0.01))
    assets = f"""<asset><mesh name="slab" vertex="{corners}"/>
        <hfield name="land" nrow="3" ncol="3" size="1 1 .1 .1" elevation="0 0 0 0 0 0 0 0 0"/></asset>"""
    for geom in ('type="mesh" mesh="slab"', 'type="hfield" hfield="land" pos="0 0 .01"'):
        world = f'<geom name="ground" {geom} condim="1"/>' + ball(pos="0.13 0.17 1", size="0.02")
        model, data = compiled(world, rest=assets)
        data.qvel[2] = -200.0
        stepper = Stepper(model, MaximalDissipation())
        for _ in range(3):
            stepper.step(data)
        assert data.qpos[2] == pytest.approx(0.03, abs=1e-7), geom
        assert abs(data.qvel[2]) < 1e-9


def test_a_spinning_rod_hits_the_floor():
    rod = '<body pos="0 0 .6"><freejoint/><geom name="rod" type="capsule" size=".005 .5" condim="1"/></body>'
    model, data = compiled(FLOOR + rod, option='timestep="0.01" gravity="0 0 0" integrator="RK4"')
    data.qvel[:] = 0, 0, -5, 0, 300, 0
    energy = 0.5 * data.qvel @ mass_matrix(model, data) @ data.qvel
    stepper = Stepper(model, Moreau(1))
    events = []
    for _ in range(10):
        stepper.step(data)
        events += stepper.events
        assert read_contacts(model, data, within=0.0).gap.min(initial=0.0) >= -1e-9
    assert events
    assert 0.5 * data.qvel @ mass_matrix(model, data) @ data.qvel == pytest.approx(energy, rel=1e-6)


def test_overlap_at_the_start_is_named_with_its_depth():
    model, data = compiled(FLOOR + ball(pos="0 0 0.07"))
    with pytest.raises(OverlapError, match=r"floor/ball by 0\.03 m"):
        Stepper(model, Moreau(1)).step(data)


def test_overlap_made_between_steps_is_named_too():
    model, data = compiled(FLOOR + ball())
    stepper = Stepper(model, Moreau(1))
    stepper.step(data)
    data.qpos[2] = 0.05
    with pytest.raises(OverlapError, match=r"floor/ball by 0\.05 m"):
        stepper.step(data)


@pytest.mark.parametrize(
    ("world", "rest", "message"),
    [
        (FLOOR.replace("/>", ' adhesion="1"/>') + ball(), "", "adhesion"),
        (FLOOR + ball(), '<actuator><adhesion body="ball" ctrlrange="0 1"/></actuator>', "adhesion"),
        (
            FLOOR + ball().replace("/>", ' name="free"/>', 1),
            '<actuator><motor joint="free" gear="1 0 0 0 0 0" delay="0.01" nsample="9"/></actuator>',
            "delay",
        ),
    ],
)
def test_what_rigid_stepping_does_not_cover_is_refused(world, rest, message):
    model, _ = compiled(world, rest=rest)
    with pytest.raises(SceneError, match=message):
        Stepper(model, Moreau(1))


def test_friction_can_be_ignored_on_request():
    model, data = compiled(FLOOR + ball(pos="0 0 0.1", condim=3))
    data.qvel[:3] = 1.0, 0.0, -1.0
    stepper = Stepper(model, Moreau(1), friction="ignore")
    stepper.step(data)
    assert data.qvel == pytest.approx([1, 0, 1, 0, 0, 0])


def test_a_matrix_that_creates_energy_is_raised_projected_or_allowed():
    gains = Fremond([[0.0, 2.0], [2.0, 0.0]])
    model, data = load("ball_chain")
    before = data.qpos.copy(), data.qvel.copy()
    with pytest.raises(InadmissibleImpactError, match=r"ball1/ball2, ball2/ball3.*T\+/T-"):
        Stepper(model, gains).step(data)
    assert (data.qpos == before[0]).all()
    assert (data.qvel == before[1]).all()
    allowed, projected = (Stepper(model, gains, on_inadmissible=option) for option in ("allow", "project"))
    projected.step(data)
    impact = projected.events[0].impact
    assert impact.violations.is_admissible(1e-9)
    assert impact.energy_change == pytest.approx(0.0, abs=1e-9)
    _, data = load("ball_chain")
    allowed.step(data)
    assert allowed.events[0].impact.energy_change > 0.1


def test_the_scene_carries_its_own_restitution():
    rest = """<custom><numeric name="restitution" data="0.5"/>
        <numeric name="restitution/ball/floor" data="0.9"/></custom>"""
    model, data = compiled(FLOOR + ball(pos="0 0 .1") + ball("other", "1 0 .1"), rest=rest)
    data.qvel[[2, 8]] = -1.0
    Stepper(model, "scene").step(data)
    assert data.qvel[[2, 8]] == pytest.approx([0.9, 0.5])


@pytest.mark.parametrize(
    ("numeric", "error", "message"),
    [
        ('<numeric name="restitution" data="1.5"/>', RestitutionError, "1.5"),
        ('<numeric name="restitution/ball/flor" data="0.5"/>', UnknownNameError, "ball/floor"),
        ('<numeric name="other" data="0.5"/>', RestitutionError, "carries no restitution"),
    ],
)
def test_wrong_restitution_in_the_scene_is_named(numeric, error, message):
    model, _ = compiled(FLOOR + ball(), rest=f"<custom>{numeric}</custom>")
    with pytest.raises(error, match=message):
        Stepper(model, "scene")


def test_a_law_for_contacts_the_scene_cannot_have_is_refused():
    model, _ = compiled(FLOOR + ball())
    with pytest.raises(UnknownNameError, match="floor/ball"):
        Stepper(model, Newton({("ball", "flor"): 0.5}, default=1.0))


@pytest.mark.parametrize(
    "option", [{"contact_model": "hard"}, {"friction": "no"}, {"on_inadmissible": "warn"}, {"solver": "simplex"}]
)
def test_unknown_options_are_named(option):
    model, _ = compiled(FLOOR + ball())
    with pytest.raises(UnknownNameError, match=str(next(iter(option.values())))):
        Stepper(model, Moreau(1), **option)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_broken_state_is_an_error_and_no_silent_reset(value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning to a file in the current folder
    model, data = compiled(FLOOR + ball())
    data.time = 1.0
    data.qvel[0] = value
    stepper = Stepper(model, Moreau(1))
    with pytest.raises(DivergenceError, match="not finite"):
        stepper.step(data)
    assert data.time == 1.0
    assert not np.isfinite(data.qvel[0])


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
    """Held corners are pushed out further than contacts are looked for, and others come near meanwhile."""
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


@pytest.mark.parametrize("timestep", [1e-3, 1e-2])
def test_a_stiff_actuator_leaves_no_step_in_penetration(timestep):
    """A rebound that is rest over short flows only: the block must not be left inside the wall."""
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


def test_a_gap_tolerance_below_the_rounding_of_positions_is_refused():
    model, data = compiled(FLOOR + ball(pos="0 0 2e6", size="1e6"))
    with pytest.raises(SceneError, match=r"tolerance of 1e-09 m is below the rounding.*pass gap_tolerance=2e-03"):
        Stepper(model, Moreau(1))
    data.qvel[2] = -2e8
    Stepper(model, Moreau(1), gap_tolerance=1e-3).step(data)
    assert [data.qpos[2], data.qvel[2]] == pytest.approx([2e6, 2e8], rel=1e-9)
