"""Time stepping creates no energy."""

import mujoco
import numpy as np
import pytest
from scenes import compiled
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Coulomb, Fremond, MaximalDissipation, Moreau, Newton, Poisson
from impactlaw.models import SCENES, load

LAWS = {
    "maximal dissipation": MaximalDissipation(),
    "moreau .8": Moreau(0.8),
    "moreau 1": Moreau(1.0),
    "newton": Newton(1.0),
    "poisson": Poisson(0.7),
    "reversal": Fremond.reversal(0.9),
}


def energies(model, data, law, duration):
    """Return the energy at the start and after every step."""
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    mujoco.mj_forward(model, data)
    stepper, seen = stepping(model, law), [data.energy.sum()]
    for _ in range(round(duration / model.opt.timestep)):
        stepper.step(data)
        seen.append(data.energy.sum())
    return np.array(seen)


def growth(seen, scale):
    """Return the largest growth beyond the largest energy so far."""
    return (seen[1:] - np.maximum.accumulate(seen)[:-1]).max() / scale


def total_growth(seen, scale):
    return (seen.max() - seen[0]) / scale


PIVOTS = {"rocking_block": 5e-4, "rocking_platform": 2e-4}
"""Bodies that turn about a held contact gain a little energy, of second order in the timestep (next test)."""


@pytest.mark.parametrize("scene", SCENES)
def test_no_bundled_scene_gains_energy_under_any_law(scene):
    """Relative to the initial energy above the lowest energy that the scene reaches without restitution."""
    lowest = min(energies(*load(scene), MaximalDissipation(), 1.2))
    for name, law in LAWS.items():
        seen = energies(*load(scene), law, 1.2)
        scale = seen[0] - lowest
        assert total_growth(seen, scale) <= PIVOTS.get(scene, 1e-6), name


@pytest.mark.parametrize("scene", SCENES)
def test_what_scenes_gain_is_of_second_order(scene):
    gains = []
    for divided in (1, 2, 4):
        model, data = load(scene)
        model.opt.timestep /= divided
        seen = energies(model, data, Moreau(0.5), 0.3)
        gains.append(max(seen.max() - seen[0], 1e-12))
    assert gains[2] < 1e-11 or gains[0] / gains[2] > 8


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_a_tumbling_box_that_falls_on_the_floor_gains_none(law, condim):
    world = FLOOR + '<body pos="0 0 .4" euler="20 30 40"><freejoint/><geom type="box" size=".1 .2 .3"/></body>'
    model, data = compiled(world, geom=f'condim="{condim}" friction=".4 .01 .001"', option='timestep="1e-3"')
    data.qvel[:3] = 1.0, 0.5, -1.0
    seen = energies(model, data, law, 0.6)
    if condim == 1 and law in (Moreau(1.0), Newton(1.0)):  # the rest is a gain of the free motion
        assert abs(seen / seen[0] - 1).max() <= 1e-6
    else:
        assert growth(seen, seen[0] - seen.min() + 0.1) <= 1e-6


def test_tumbling_free_boxes_keep_energy_and_angular_momentum():
    world = '<body><freejoint/><geom type="box" size=".1 .2 .3"/></body>'
    model, data = compiled(world, option='gravity="0 0 0" timestep="2e-3"')
    data.qvel[:] = 0.3, 0.2, 0.1, 1.0, 8.0, 1.0  # about the unstable axis
    seen = energies(model, data, Moreau(0.5), 4.0)
    assert abs(seen / seen[0] - 1).max() < 2e-3
    halved = model
    halved.opt.timestep = 1e-3
    mujoco.mj_resetData(halved, data)
    data.qvel[:] = 0.3, 0.2, 0.1, 1.0, 8.0, 1.0
    finer = energies(halved, data, Moreau(0.5), 4.0)
    assert abs(seen / seen[0] - 1).max() > 3 * abs(finer / finer[0] - 1).max()


def test_elastic_boxes_tumble_against_each_other_without_gain():
    rng = np.random.default_rng(3)
    bodies = "".join(
        f'<body pos="{0.6 * (i % 2)} {0.6 * (i // 2)} 0"><freejoint/><geom type="box" size=".1 .15 .2"/></body>'
        for i in range(4)
    )
    walls = "".join(
        f'<geom type="plane" size="9 9 1" zaxis="{z}" pos="{p}"/>'
        for z, p in (
            ("1 0 0", "-.5 0 0"), ("-1 0 0", "1.1 0 0"), ("0 1 0", "0 -.5 0"), ("0 -1 0", "0 1.1 0"),
            ("0 0 1", "0 0 -.5"), ("0 0 -1", "0 0 .5"),
        )
    )  # fmt: skip
    model, data = compiled(walls + bodies, option='gravity="0 0 0" timestep="1e-3"', geom='condim="1"')
    data.qvel[:] = rng.normal(size=model.nv)
    seen = energies(model, data, Moreau(1.0), 1.5)
    assert growth(seen, seen[0]) <= 1e-6


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_the_impact_of_a_box_that_spins_creates_no_energy(e):
    """A single elastic impact conserves energy however the box spins, including the gyroscopic forces of that step."""
    for tilt in (10, 30, 50, 70):
        world = FLOOR + f'<body pos="0 0 .35" euler="{tilt} 20 0"><freejoint/><geom type="box" size=".1 .2 .3"/></body>'
        model, data = compiled(world, option='gravity="0 0 0" timestep="2e-3"', geom='condim="1"')
        data.qvel[:] = 0.0, 0.0, -3.0, 4.0, -3.0, 2.0
        model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
        mujoco.mj_forward(model, data)
        stepper, impacts = stepping(model, Newton(e)), 0
        for _ in range(100):
            before = data.energy[1]
            stepper.step(data)
            if stepper.events:
                impacts += 1
                assert data.energy[1] <= before * (1 + 1e-6)
                if e == 1:
                    assert data.energy[1] == pytest.approx(before, rel=1e-6)
        assert impacts


def test_a_limb_of_ball_joints_that_spins_fast_keeps_finite_energy():
    """Half a radian per step is too fast for the timestep, but it does not explode."""
    world = """<body><joint type="ball" range="0 60"/><geom type="capsule" fromto="0 0 0 .1 0 0" size=".02" mass=".1"/>
        <body pos=".1 0 0"><joint type="ball" range="0 60"/>
        <geom type="box" size=".02 .05 .1" pos=".05 0 .05" mass="5"/>
        <body pos=".1 0 0"><joint type="ball"/><geom type="box" size=".01 .05 .03" pos=".05 .02 0" mass=".01"/>
        </body></body></body>"""
    model, data = compiled(world, option='gravity="0 0 0" timestep="5e-3"', geom='contype="0"')
    data.qvel[:] = 10.0, 20.0, -30.0, 15.0, -25.0, 20.0, 40.0, -60.0, 50.0
    seen = energies(model, data, Newton(0.8), 1.0)
    assert seen.max() < 2.5 * seen[0]


def test_an_elastic_body_off_its_centre_of_mass_gains_to_second_order():
    """Its mass matrix depends on its orientation, and takes part in the collision."""
    gains = []
    for timestep in (4e-3, 2e-3, 1e-3):
        world = (
            FLOOR
            + """<body pos="0 0 2" euler="30 20 10"><freejoint/>
            <geom type="box" size=".05 .1 .3" pos=".05 0 .05"/></body>"""
        )
        model, data = compiled(world, option=f'timestep="{timestep}"', geom='condim="1"')
        seen = energies(model, data, Moreau(1.0), 1.2)
        gains.append(abs(seen / seen[0] - 1).max())
    assert gains[1] < 2e-4
    assert gains[0] / gains[2] > 8


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("heavy", [1.0, 1000.0])
def test_a_heavy_link_on_a_light_base_gains_little(e, heavy):
    """The gain is of second order in the timestep; a gain of first order would be 1 % with e = 0.5."""
    world = (
        FLOOR
        + f"""<body pos="0 0 1"><freejoint/><geom size=".05" mass="1e-3"/><body pos=".3 .1 .2"><joint axis="0 1 .3"/>
        <geom type="capsule" fromto="0 0 0 .3 0 .1" size=".05" mass="{heavy}"/></body></body>"""
    )
    model, data = compiled(world, option='timestep="2e-3"', geom='condim="1"')
    data.qvel[:] = 0.0, 0.0, 0.0, 0.3, 0.0, 0.5, 1.0
    seen = energies(model, data, Moreau(e), 1.0)
    assert growth(seen, seen[0]) <= (2e-3 if e == 1.0 else 1e-6)


def test_a_limit_of_a_link_far_heavier_than_its_base_makes_no_energy():
    world = """<body><freejoint/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".05" mass="1"/><body pos=".3 0 0">
        <joint axis="0 1 0" range="-40 10"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".05" mass="1000"/>
        </body></body>"""
    model, data = compiled(world, option='gravity="0 0 0" timestep="5e-3"', geom='contype="0" conaffinity="0"')
    data.qvel[:] = 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 10.0
    seen = energies(model, data, Moreau(1.0), 1.0)
    assert total_growth(seen, seen[0]) < 0.01


def test_what_turns_too_fast_for_the_timestep_still_falls():
    world = """<body pos="0 0 5"><freejoint/><geom type="box" size=".01 .05 .1" pos=".02 .01 0"/></body>
        <body pos="5 0 5"><freejoint/><geom type="box" size=".01 .05 .1"/></body>"""
    model, data = compiled(world, option='timestep="5e-3"')
    data.qvel[3:6] = data.qvel[9:12] = 300.0, 200.0, -400.0
    seen = energies(model, data, Moreau(0.5), 0.5)
    kinetic = seen - model.body_mass[1:].sum() * 9.81 * 5
    assert kinetic.max() <= kinetic[0] * (1 + 1e-9)
    assert data.xipos[2, 2] == pytest.approx(5 - 0.5 * 9.81 * 0.25, abs=0.01)


BEAD = """<body><joint axis="0 0 1" armature="1e-4"/><geom size=".02" mass=".001"/>
    <body pos=".1 0 0"><joint type="slide" axis="1 0 0" range="0 .1" stiffness="10" springref="-1"/>
    <geom size=".02" mass="1"/></body></body>"""
"""A spring holds a bead at the inner stop of a rotating arm: the motion is steady."""

ELBOW = """<body><joint axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
    <body pos=".3 0 0"><joint axis="0 0 1" range="0 57.3"/>
    <geom type="capsule" fromto="0 0 0 .1 .2 0" size=".03" mass="1"/></body></body>"""
"""The rotation holds an elbow at its limit."""


@pytest.mark.parametrize(("world", "speed", "part"), [(BEAD, 1.0, 5e-5), (ELBOW, 30.0, 0.02)])
def test_contact_that_is_held_in_a_turning_frame_does_no_work(world, speed, part):
    errors = []
    for timestep in (4e-3, 2e-3, 1e-3):
        option = f'gravity="0 0 0" timestep="{timestep}"'
        model, data = compiled(world, option=option, geom='contype="0" conaffinity="0"')
        data.qvel[0] = speed
        seen = energies(model, data, Moreau(0.0), 0.5)
        errors.append(abs(seen[-1] / seen[0] - 1))
    assert errors[0] < part
    assert errors[0] / errors[2] > 8


def test_two_elastic_balls_that_fall_one_on_the_other_keep_their_energy():
    """The upper ball is hit in the step in which the lower one hits the floor; gravity acts in this step, too."""
    world = (
        FLOOR
        + """<body pos="0 0 .6"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>
        <body pos="0 0 .8005"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>"""
    )
    for timestep in (4e-3, 1e-3):
        model, data = compiled(world, option=f'timestep="{timestep}"')
        seen = energies(model, data, Moreau(1.0), 0.6)
        assert abs(seen / seen[0] - 1).max() < 1e-10


@pytest.mark.parametrize("e", [0.9, 1.0])
def test_restitution_that_friction_scales_gains_to_second_order(e):
    """The corner of a box that spins about a point off its centre of mass hits the floor, from twenty heights."""
    world = """<geom type="plane" size="9 9 1" friction=".5"/><body><freejoint/>
        <geom type="box" size=".05 .1 .03" pos=".1 .05 .03" mass="1" friction=".5"/></body>"""
    pose = np.array([-0.14, 0.105, 0.21532, 0.13043774, -0.86355383, -0.20028846, 0.44401049])
    velocity = [-1.182, 0.5488, -3.80616, 11.137, -2.00946, -5.8443]
    gains = []
    for timestep in (1e-3, 5e-4, 2.5e-4):
        model, data = compiled(world, option=f'timestep="{timestep}"')
        gain = 0.0
        for height in 2e-4 * np.arange(20):
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = pose, velocity
            data.qpos[2] += height
            gain = max(gain, growth(energies(model, data, Moreau(e), 0.012), 9.0))
        gains.append(gain)
    assert gains[0] < 3e-4
    assert gains[2] < 3e-5


def test_links_that_turn_by_a_radian_in_a_step_gain_no_energy():
    world = """<body><joint axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
        <body pos=".3 0 0"><joint axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass=".1"/>
        </body></body>"""
    model, data = compiled(world, option='gravity="0 0 0" timestep="4e-3"', geom='contype="0" conaffinity="0"')
    data.qpos[:], data.qvel[:] = (0.0, 0.5), (300.0, -100.0)
    seen = energies(model, data, Moreau(0.0), 0.5)
    assert growth(seen, seen[0]) <= 1e-9


def test_what_turns_too_fast_leaves_others_alone():
    link = '<joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".03"/>'
    pendulum = f'<body pos="0 0 2">{link}<body pos=".5 0 0">{link}</body></body>'
    spinning = '<body pos="50 0 5"><freejoint/><geom type="box" size=".1 .2 .05"/></body>'
    found = []
    for world in (pendulum, pendulum + spinning):
        model, data = compiled(world, option='timestep="2e-3"', geom='contype="0" conaffinity="0"')
        if model.nv > 2:
            data.qvel[-3:] = 600.0, 60.0, 120.0
        stepper = stepping(model, Moreau(0.0))
        for _ in range(250):
            stepper.step(data)
        found.append(data.qpos[:2].copy())
    np.testing.assert_allclose(found[1], found[0], atol=1e-4)


def test_restitution_along_the_tangent_creates_none():
    ball = '<body pos="0 0 .3"><freejoint/><geom size=".1"/></body>'
    model, data = compiled(FLOOR + ball, geom='friction="1"')
    data.qvel[[0, 4]] = 2.0, -30.0
    seen = energies(model, data, Coulomb(Newton(1.0), tangential_restitution=1.0), 2.0)
    assert growth(seen, seen[0]) <= 1e-9
    assert seen[-1] == pytest.approx(seen[0], rel=1e-3)
