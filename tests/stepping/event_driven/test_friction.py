"""Rigid stepping with friction: closed forms of sliding, sticking, rolling, bouncing and carrying."""

import math
from functools import partial

import gymnasium
import mujoco
import numpy as np
import pytest
import scenes
from scenes import energy, run

from impactlaw import Coulomb, MaximalDissipation, Moreau, Newton, Stepper, read_contacts
from impactlaw.errors import InvalidCollisionError
from impactlaw.stepping.event_driven.contact_set import Rows
from impactlaw.stepping.event_driven.shortcuts import Rest, Together
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases

G = 9.81
RK4 = 'timestep="0.005" integrator="RK4"'


compiled = partial(scenes.compiled, option=RK4)


def floor(mu=0.0, condim=3, rest=""):
    return f'<geom name="floor" type="plane" size="9 9 1" condim="{condim}" friction="{mu} 0 0" {rest}/>'


def box(name="box", height=0.1, mu=0.5, half=0.1, mass=1.0):
    return (
        f'<body name="{name}" pos="0 0 {height}"><freejoint/><geom name="{name}" type="box" mass="{mass}" '
        f'size="{half} {half} {half}" friction="{mu} 0 0"/></body>'
    )


def ball(height=0.1, mu=0.5, condim=3, more="0 0"):
    geom = f'<geom name="ball" size=".1" mass="1" condim="{condim}" friction="{mu} {more}"/>'
    return f'<body name="ball" pos="0 0 {height}"><freejoint/>{geom}</body>'


def sloped(angle, option=RK4):
    """Gravity leans over: the floor is an incline that falls towards x."""
    return f'{option} gravity="{G * math.sin(angle)} 0 {-G * math.cos(angle)}"'


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast", "discrete"])
@pytest.mark.parametrize("friction", ["coulomb", "convex"])
def test_a_box_sticks_to_an_incline_and_does_not_creep(integrator, friction):
    """tan(0.45) = 0.483 < 0.5, for 10 s."""
    model, data = compiled(floor() + box(), option=sloped(0.45, f'timestep="0.01" integrator="{integrator}"'))
    stepper = Stepper(model, Newton(0.5), friction=friction)
    assert run(stepper, data, 1000) == []
    assert data.qpos[:3] == pytest.approx([0.0, 0.0, 0.1], abs=1e-9)
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize(("integrator", "tolerance"), [("RK4", 1e-9), ("Euler", 5e-3)])
def test_a_box_slides_down_an_incline(integrator, tolerance):
    """tan(0.5) = 0.546 > 0.5: x = (sin - mu cos) g t^2 / 2; Euler is G h t / 2 off, as without friction."""
    model, data = compiled(floor() + box(), option=sloped(0.5, f'timestep="0.005" integrator="{integrator}"'))
    stepper = Stepper(model, Newton(0.5))
    assert run(stepper, data, 200) == []
    a = G * (math.sin(0.5) - 0.5 * math.cos(0.5))
    assert data.qvel[0] == pytest.approx(a, abs=1e-9)
    assert data.qpos[0] == pytest.approx(0.5 * a, abs=tolerance)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-9)


@pytest.mark.parametrize("timestep", [0.01, 0.005, 0.0025])
def test_a_box_stops_at_the_right_distance(timestep):
    """v^2 / (2 mu g): the step in which it stops is the only one with an error, at most mu g h^2 / 2."""
    model, data = compiled(floor() + box(), option=f'timestep="{timestep}" integrator="RK4"')
    data.qvel[:2] = 0.8, 0.6
    stepper = Stepper(model, Newton(0.5))
    run(stepper, data, round(0.5 / timestep))
    distance = 1.0 / (2 * 0.5 * G)
    assert data.qpos[:2] == pytest.approx([0.8 * distance, 0.6 * distance], abs=0.5 * 0.5 * G * timestep**2)
    rest = data.qpos.copy()
    run(stepper, data, 100)
    assert data.qpos == pytest.approx(rest, abs=1e-12)


def test_a_ball_slides_until_it_rolls():
    """From v without spin, it rolls with 5 v / 7 after 2 v / (7 mu g)."""
    mu, v = 0.2, 1.0
    model, data = compiled(floor() + ball(mu=mu))
    data.qvel[0] = v
    stepper = Stepper(model, Newton(0.5))
    start = 2 * v / (7 * mu * G)
    run(stepper, data, 100)
    assert data.time > start
    assert data.qvel[0] == pytest.approx(5 * v / 7, abs=1e-6)
    assert data.qvel[4] * 0.1 == pytest.approx(5 * v / 7, abs=1e-6)
    slid = v * start - 0.5 * mu * G * start**2
    assert data.qpos[0] == pytest.approx(slid + 5 * v / 7 * (data.time - start), abs=mu * G * 0.005**2)


def test_rolling_resistance_stops_a_ball():
    """A moment m_r N against rolling: (7/5) m a = -m_r N / R, with the coefficient m_r in meters.

    In MuJoCo's elliptic cone rolling and sliding share N: the force F = m a slips, by m_r omega F / (mu^2 N).
    """
    model, data = compiled(floor(condim=6) + ball(mu=1.0, condim=6, more="0.001 0.002"))
    data.qvel[0], data.qvel[4] = 1.0, 10.0
    stepper = Stepper(model, Newton(0.5))
    run(stepper, data, 200)
    a = 5 / 7 * 0.002 / 0.1 * G
    slip = 0.002 * 10 * a / G
    assert data.qvel[0] == pytest.approx(1.0 - a * data.time, abs=slip)
    assert data.qvel[0] - 0.1 * data.qvel[4] == pytest.approx(0.002 * data.qvel[4] * a / G, rel=0.01)


def test_torsion_stops_a_spinning_ball():
    """I alpha = -m_s N about the normal."""
    model, data = compiled(floor(condim=4) + ball(mu=1.0, condim=4, more="0.01 0"))
    data.qvel[5] = 20.0
    stepper = Stepper(model, Newton(0.5))
    inertia = 0.4 * 0.01
    run(stepper, data, 100)
    assert data.qvel[5] == pytest.approx(20.0 - 0.01 * G * data.time / inertia, abs=1e-6)
    run(stepper, data, 100)
    assert np.abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize(("mu", "slips"), [(0.03, True), (0.9, False)])
@pytest.mark.parametrize("law", [Newton(0.6), Coulomb(Newton(0.6), tangential_restitution=0.4)])
def test_an_oblique_bounce(law, mu, slips):
    """Slip: Lambda_t = mu Lambda_n; stick: the contact point's velocity is -e_t times the one before."""
    model, data = compiled(floor() + ball(height=0.5, mu=mu), option='timestep="0.01" gravity="0 0 0"')
    data.qvel[:] = 1.0, 0.0, -2.0, 0.0, 5.0, 0.0
    (event,) = run(Stepper(model, law), data, 40)
    e_t = 0.4 if isinstance(law, Coulomb) else 0.0
    sliding = 1.0 - 0.5  # v - omega R
    impulse = -mu * 1.6 * 2.0 if slips else -(1 + e_t) * sliding * 2 / 7
    assert abs(impulse) <= mu * 3.2 + 1e-12
    assert data.qvel == pytest.approx([1.0 + impulse, 0.0, 1.2, 0.0, 5.0 - 0.1 * impulse / 0.004, 0.0], abs=1e-9)
    assert event.impact.impulse == pytest.approx([3.2])
    assert np.linalg.norm(event.impact.friction_impulse) == pytest.approx(abs(impulse), rel=1e-9)
    assert event.impact.violations.is_admissible()


@pytest.mark.parametrize("integrator", ["RK4", "Euler"])
def test_a_stack_stands_for_ten_seconds(integrator):
    stack = "".join(box(f"b{i}", 0.1 + 0.2 * i, mass=1.0 + 3 * (i % 2)) for i in range(4))
    model, data = compiled(floor() + stack, option=f'timestep="0.02" integrator="{integrator}"')
    start = data.qpos.copy()
    assert run(Stepper(model, Newton(0.5)), data, 500) == []
    assert data.qpos == pytest.approx(start, abs=1e-8)
    assert np.abs(data.qvel).max() < 1e-8


def test_a_belt_takes_a_box_along():
    """It accelerates with mu g to the belt's speed, and then goes with it."""
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
    """Painlevé's rod, mu above 4/3: it turns about the end that jams. Sustained contact is of second order in the
    timestep, so that 2e-6 J may come and go within one; impacts never create any."""
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
    """With friction and random controls: no divergence, no penetration, impacts that create no energy."""
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
    assert stepper.unlocated <= 5  # a foot squeezed between floor and thigh bounces between both without end


def test_a_phase_may_start_where_nothing_was_held_in_the_end(monkeypatch):
    """The forces of the phase before are known, and are of no contact: found under a coin that rolls on its rim."""
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
    """Its contact point runs round the rim faster than the coin moves, and is one contact all the same."""
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
    """A block between walls that are 1e-10 m too near, and one that slides on a table through which it cannot move."""
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
