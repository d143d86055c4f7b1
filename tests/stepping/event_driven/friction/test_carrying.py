"""Stacks, belts, trays, robots and coins in rigid stepping with friction."""

import gymnasium
import mujoco
import numpy as np
import pytest
import scenes
from scenes import energy, run
from stepping.event_driven.friction.bodies import G, ball, box, compiled, floor, sloped

from impactlaw import MaximalDissipation, Moreau, Newton, Stepper, read_contacts
from impactlaw.errors import InvalidCollisionError
from impactlaw.stepping.event_driven.contact_set import Rows
from impactlaw.stepping.event_driven.shortcuts import Rest, Together
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases


@pytest.mark.parametrize("integrator", ["RK4", "Euler"])
def test_a_stack_stands_for_ten_seconds(integrator):
    stack = "".join(box(f"b{i}", 0.1 + 0.2 * i, mass=1.0 + 3 * (i % 2)) for i in range(4))
    model, data = compiled(floor() + stack, option=f'timestep="0.02" integrator="{integrator}"')
    start = data.qpos.copy()
    assert run(Stepper(model, Newton(0.5)), data, 500) == []
    assert data.qpos == pytest.approx(start, abs=1e-8)
    assert np.abs(data.qvel).max() < 1e-8


def test_a_belt_takes_a_box_along():
    """It accelerates with mu g to the speed of the belt, and then moves with it."""
    model, data = compiled(floor(rest='surfacevel="0.5 0 0 0 0 0"') + box(mu=0.4))
    stepper = Stepper(model, Newton(0.5))
    run(stepper, data, 20)
    assert data.qvel[0] == pytest.approx(0.4 * G * data.time, abs=1e-9)
    run(stepper, data, 180)
    assert data.qvel[:3] == pytest.approx([0.5, 0.0, 0.0], abs=1e-9)
    stop = 0.5 / (0.4 * G)
    assert data.qpos[0] == pytest.approx(0.5 * (data.time - stop) + 0.25 * stop, abs=0.4 * G * 0.005**2)


@pytest.mark.parametrize("acceleration", [2.0, 6.0])
def test_a_tray_takes_a_box_along_up_to_mu_g(acceleration):
    geom = '<geom name="tray" type="box" size="3 1 .1" pos="0 0 -.1" friction="0 0 0"/>'
    tray = f'<body name="tray" mocap="true">{geom}</body>'
    model, data = compiled(tray + box(mu=0.4))
    stepper = Stepper(model, Newton(0.5))
    run(stepper, data, 2)
    start = data.time
    for _ in range(100):
        data.mocap_pos[0, 0] = 0.5 * acceleration * (data.time + 0.005 - start) ** 2
        stepper.step(data)
    t, a = data.time - start, min(acceleration, 0.4 * G)
    assert data.qvel[0] == pytest.approx(a * t, abs=2 * a * 0.005)
    assert data.qpos[0] == pytest.approx(0.5 * a * t * t, abs=2 * a * 0.005 * t)


def test_without_coefficients_friction_is_nothing():
    model, data = compiled(floor() + box(mu=0.0), option=sloped(0.3))
    stepper = Stepper(model, Moreau(0.5))
    assert not stepper.plan.friction
    rough, other = compiled(floor() + box(mu=0.5), option=sloped(0.3))
    ignoring = Stepper(rough, Moreau(0.5), friction="ignore")
    data.qvel[2] = other.qvel[2] = -1.0
    run(stepper, data, 50)
    run(ignoring, other, 50)
    np.testing.assert_array_equal(data.qpos, other.qpos)


def test_a_rod_that_falls_obliquely_on_one_end_jams_without_gaining_energy():
    """Painlevé's rod, mu above 4/3: it turns about the end that jams, and impacts never create energy.

    Sustained contact is of second order in the timestep, so that up to 2e-6 J may come and go within a step.
    """
    rod = (
        '<body name="rod" pos="0 0 .43"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        '<joint axis="0 -1 0"/><geom name="rod" type="capsule" fromto="-.25 0 -.4330127 .25 0 .4330127" size=".01" '
        'mass="1" friction="2 0 0"/></body>'
    )
    model, data = compiled(floor() + rod, option='timestep="0.001" integrator="RK4"')
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data.qpos[1] = 0.4330127 + 0.01 - 0.43
    data.qvel[0] = 1.0
    stepper = Stepper(model, MaximalDissipation())
    mujoco.mj_forward(model, data)
    energy = data.energy.sum()
    for _ in range(1500):
        stepper.step(data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        assert data.energy.sum() <= energy + 2e-6
        energy = data.energy.sum()
        for event in stepper.events:
            assert event.impact.violations.is_admissible()


def test_the_admissible_set_is_for_contacts_without_friction():
    model, data = compiled(floor() + ball(height=0.1))
    data.qvel[2] = -1.0
    (event,) = run(Stepper(model, Moreau(0.5)), data, 1)
    assert not event.impact.collision.has_admissible_set
    with pytest.raises(InvalidCollisionError, match="without friction"):
        _ = event.impact.collision.admissible_set


@pytest.mark.usefixtures("quiet")
@pytest.mark.filterwarnings("ignore::impactlaw.errors.ManyCollisionsWarning")
@pytest.mark.parametrize(("name", "steps"), [("Ant-v5", 300), ("Humanoid-v5", 230), ("Hopper-v5", 300)])
def test_gymnasium_robots_run_on_rigid_contact(name, steps):
    """With friction and random controls there is no divergence and no penetration, and impacts do not create energy."""
    unwrapped = gymnasium.make(name).unwrapped
    unwrapped.reset(seed=0)
    model, data = unwrapped.model, unwrapped.data
    stepper = Stepper(model, Newton(0.3), overlap="push-out")
    assert stepper.plan.friction
    rng = np.random.default_rng(0)
    collisions = 0
    for step in range(steps):
        if step % 5 == 0:
            data.ctrl[:] = 0.4 * rng.uniform(*model.actuator_ctrlrange.T)
        stepper.step(data)
        assert read_contacts(model, data).gap.min(initial=0.0) > -1e-7
        for event in stepper.events:
            collisions += 1
            assert event.impact.violations.energetic <= 1e-9 * event.impact.collision.pre_speed
            assert event.impact.residual < 1e-8
    assert np.isfinite(data.qpos).all()
    assert collisions > 5
    assert stepper.unlocated <= 5  # a foot squeezed between floor and thigh bounces between them without end


def test_a_phase_may_start_where_nothing_was_held_in_the_end(monkeypatch):
    """The last phase's forces are known but have no contacts, as happened under a coin that rolls on its rim."""
    model, data = compiled(floor() + box())
    stepper = Stepper(model, Newton(0.5))
    stepper.step(data)
    advance, known = SmoothPhases.advance_to_contact, []

    def advance_on(self, state, start, *args, **options):
        known.append(start.contact_forces)
        nothing = Rows(*(part[:0] for part in start.contact_forces.rows))
        start = start._replace(contact_forces=start.contact_forces._replace(rows=nothing))
        return advance(self, state, start, *args, **options)

    monkeypatch.setattr(SmoothPhases, "advance_to_contact", advance_on)
    for shortcut in (Rest, Together):
        monkeypatch.setattr(shortcut, "lasts", lambda *args: None)
    stepper.step(data)
    assert len(known) == 1
    assert data.qpos[:3] == pytest.approx([0.0, 0.0, 0.1], abs=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.5])
def test_a_coin_that_rolls_on_its_rim_stays_in_contact(integrator, restitution):
    """Its contact point moves along the rim faster than the coin, but is a single contact."""
    coin = (
        '<body name="coin" pos="0 0 .2"><freejoint/>'
        '<geom type="cylinder" size=".1 .005" mass="1" friction=".3"/></body>'
    )
    option = f'<option timestep="0.002" integrator="{integrator}"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco>{option}<worldbody><geom type="plane" size="5 5 1" friction=".3"/>{coin}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[3:7] = np.cos(0.5), np.sin(0.5), 0, 0
    data.qvel[3:] = 0.3, 2, 10
    stepper, energies, collisions = Stepper(model, Moreau(restitution)), [], 0
    for _ in range(300):
        stepper.step(data)
        assert read_contacts(model, data).gap.min(initial=0.0) > -1e-9
        energies.append(energy(model, data))
        collisions += len(stepper.events)
    assert stepper.unlocated == 0
    assert 0 < collisions < 20
    assert np.diff(energies).max() < 1e-3
    assert energies[-1] < 0.75 * energies[0]
    assert -1e-9 < read_contacts(model, data).gap.min() < 1e-9


def test_what_cannot_give_way_keeps_nothing_else_from_being_corrected():
    """A block between walls that are 1e-10 m too close, and a slider on a table through which it cannot move."""
    floor = '<geom name="floor" type="plane" size="9 9 1"/>'
    walls = "".join(f'<geom type="box" size=".1 .1 .1" pos="{x} 0 .5"/>' for x in (-1.2, -0.8000000001))
    block = (
        '<body pos="-1.00000000005 0 .5"><joint type="slide" axis="1 0 0"/><geom type="box" size=".1 .05 .05"/></body>'
    )
    slider = (
        '<body pos="0 1 .1"><joint type="slide" axis="1 0 0" damping="1"/><geom type="box" size=".1 .1 .1"/></body>'
    )
    ball = '<body pos="0 0 .1"><freejoint/><geom size=".1"/></body>'
    arm = '<body pos="1 0 1"><joint axis="0 1 0" range="0 90"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>'
    for friction in ("ignore", "coulomb"):
        model, data = scenes.compiled(
            floor + walls + block + slider + ball + arm + "</body>", option='timestep="0.005"'
        )
        data.qfrc_applied[-1] = -5.0  # presses the arm to its limit
        stepper = Stepper(model, Moreau(0.0), friction=friction)
        for _ in range(40):
            stepper.step(data)
            assert data.qpos[-1] >= -1e-9
            assert data.qpos[4] >= 0.1 - 1e-9
        assert stepper.unlocated == 0
