"""Time stepping takes gyroscopic forces into account wherever moments of inertia differ, also if they change later."""

import mujoco
import numpy as np
import pytest
from scenes import compiled, energy
from stepping.time_stepping.stepped import on_a_tendon

from impactlaw import Moreau, Stepper
from impactlaw.batch import Batch

OPTION = 'gravity="0 0 0" timestep="5e-3"'
BALL = '<geom size=".1" mass="1"/>'
SPIN = (0.0, 0.0, 0.0, 5.0, 8.0, 0.1)
UNEVEN = (0.01, 0.02, 0.03)


def _gain(stepper, data):
    """Return the relative energy gain over 2 s of a free body that starts to spin now; 1.3e-4 is of second order."""
    data.qvel[:] = SPIN
    start = energy(stepper.model, data)
    for _ in range(400):
        stepper.step(data)
    return energy(stepper.model, data) / start - 1.0


def test_balls_that_are_fixed_to_a_ball_in_its_centre():
    around = "".join(f'<body pos="{x} {y} 0">{BALL}</body>' for x, y in ((0.3, 0), (-0.3, 0), (0, 0.2), (0, -0.2)))
    model, data = compiled(f"<body><freejoint/>{BALL}{around}</body>", option=OPTION)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    assert abs(_gain(stepper, data)) < 5e-4


def test_inertia_that_is_changed_later():
    model, data = compiled(f"<body><freejoint/>{BALL}</body>", option=OPTION)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    stepper.step(data)
    model.body_inertia[1] = UNEVEN
    mujoco.mj_setConst(model, mujoco.MjData(model))
    assert abs(_gain(stepper, data)) < 5e-4


def test_a_ball_whose_place_on_its_body_is_changed_later():
    model, data = compiled(f'<body><freejoint/>{BALL}<body name="fixed">{BALL}</body></body>', option=OPTION)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    stepper.step(data)
    model.body_pos[model.body("fixed").id] = 0.3, 0.2, 0.0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    assert abs(_gain(stepper, data)) < 2e-3


def test_inertia_of_the_worlds_of_a_batch():
    model, _ = compiled(f"<body><freejoint/>{BALL}</body>", option=OPTION)
    batch = Batch(model, Moreau(0.5), 2, 1)
    batch.expand("body_inertia")[1, 1] = UNEVEN
    batch.expand("dof_M0")[1, 3:] = UNEVEN
    batch.set_law(Moreau(0.6))
    qvel = batch.bind("qvel")
    qvel[:] = SPIN
    batch.step(nstep=400)
    np.testing.assert_allclose(qvel[0], SPIN, atol=1e-12)
    energies = [np.dot(UNEVEN, np.square(spin)) for spin in (SPIN[3:], qvel[1, 3:])]
    assert abs(energies[1] / energies[0] - 1.0) < 5e-4


TIP = """<geom type="plane" size="9 9 1"/><body pos="0 0 .3"><freejoint/>
    <inertial mass="1" pos=".07 .06 .07" diaginertia="4e-3 3e-3 3e-3"/><geom size=".02" pos="0 0 -.1"/></body>"""


def test_a_tip_that_hits_at_the_very_end_of_a_step_gains_no_energy_of_first_order():
    """The spin of 40 rad/s after the collision changes its time by some percent of a step of 1 ms."""
    model, data = compiled(TIP, option='gravity="0 0 0" timestep="1e-3"', geom='condim="1"')
    gains = []
    for part in np.linspace(1.4, 1.6, 81):
        mujoco.mj_resetData(model, data)
        data.qpos[2], data.qvel[:] = 0.12 + part * 4e-3, (0.0, 0.0, -4.0, 0.0, 0.0, 0.0)
        start, collisions = energy(model, data), 0
        stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
        for _ in range(2):
            stepper.step(data)
            collisions += len(stepper.events)
        assert collisions == 1
        gains.append(energy(model, data) / start - 1.0)
    assert np.abs(gains).max() < 1e-3


def test_what_a_moving_surface_gives_is_no_energy_from_nowhere():
    """A plate at 1 m/s hits a fast spinning body at rest, which leaves at 1.5 m/s and spins on."""
    body = f'<inertial mass="1" pos="0 0 0" diaginertia="{" ".join(map(str, UNEVEN))}"/><geom size=".1"/>'
    plate = '<body mocap="true"><geom type="box" size=".1 1 1"/></body>'
    model, data = compiled(f"{plate}<body><freejoint/>{body}</body>", option=OPTION, geom='condim="1"')
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    data.qvel[5] = 400.0
    for step in range(60):
        data.mocap_pos[0, 0] = -0.3 + step * model.opt.timestep
        stepper.step(data)
    np.testing.assert_allclose(data.qvel, (1.5, 0.0, 0.0, 0.0, 0.0, 400.0), atol=1e-8)


LINK = """<geom type="plane" size="1 1 1"/>
    <body pos="0 0 .1"><freejoint/><geom type="box" size=".05 .02 .01" mass=".1"/>
        <body pos=".06 0 0"><joint type="ball"/><geom type="box" pos=".02 0 0" size=".02 .01 .002" mass=".001"/></body>
    </body>"""


@pytest.mark.parametrize("seed", [18, 25, 27])
def test_a_light_link_that_turns_by_radians_in_a_step_does_not_diverge(seed):
    """The iterations for the forces of half a step grow beyond all numbers, which is no reason to stop."""
    rng = np.random.default_rng(seed)
    model, data = compiled(LINK, option='gravity="0 0 0"', geom='condim="1"')
    attitude = rng.normal(size=4)
    data.qpos[3:7] = attitude / np.linalg.norm(attitude)
    data.qvel[:] = 0.0, 0.0, -1.0, *(5.0 * rng.normal(size=3)), *(2000.0 / 1.7 * rng.normal(size=3))
    start = energy(model, data)
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
    for _ in range(50):
        stepper.step(data)
    assert energy(model, data) < 1.01 * start


@pytest.mark.parametrize("start", [(1.0471938, -214.0, 0.024), (1.0471966, -194.0, 0.165), (1.0471967, -225.0, 0.0048)])
def test_links_that_turn_fast_and_hardly_hit_a_limit_go_on_as_if_a_tendon_had_it(start):
    """Between half steps the limit is hit no more: what contact has done then is no part of the inertial forces."""
    link = '<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass="{}"/>'.format
    limits = f"{np.radians(-60)!s} {np.radians(60)!s}"
    knee = f'<joint name="knee" axis="0 0 1" limited="true" range="{limits}"/>'
    scene = f"""<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
        <body><joint axis="0 0 1"/>{link(1)}<body pos=".2 0 0">{knee}{link(0.3)}</body></body></worldbody></mujoco>"""
    found = []
    for xml in (scene, on_a_tendon(scene, "knee", limits)):
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        data.qpos[1], *data.qvel[:] = start
        Stepper(model, Moreau(0.5), scheme="time-stepping").step(data, 3)
        found.append(data.qvel)
    np.testing.assert_allclose(*found, rtol=1e-10)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_friction_elsewhere_in_the_scene_costs_elastic_bodies_no_energy(friction):
    floor = '<geom type="plane" size="0 0 1"/>'
    box = '<body pos="0 0 .5"><freejoint/><geom type="box" size=".1 .05 .03" pos=".04 0 0"/></body>'
    ball = f'<body pos="50 0 1"><freejoint/><geom size=".1" condim="3" friction="{friction}"/></body>'
    model, data = compiled(floor + box + ball, option='timestep="2e-3"', geom='condim="1" friction="0"')
    data.qvel[:6] = 1.0, 0.0, -1.0, 3.0, -8.0, 2.0
    start = energy(model, data)
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
    stepper.step(data, 450)
    assert energy(model, data) == pytest.approx(start, abs=2e-3)  # the box has 7 J
