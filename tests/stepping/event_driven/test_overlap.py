"""Overlap at the start of rigid stepping, pushed out by the smallest shift in the kinetic metric; exact answers."""

import gymnasium
import mujoco
import numpy as np
import pytest
import scenes

from impactlaw import MaximalDissipation, Moreau, Stepper, read_contacts
from impactlaw.envs import ImpactLaw
from impactlaw.errors import OverlapError, UnfinishedStepError, UnknownNameError
from impactlaw.stepping.event_driven import scheme as rigid
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases

H = 0.002
FLOOR = '<geom name="floor" type="plane" size="5 5 .1"/>'
BALL = '<geom name="ball" type="sphere" size=".1" mass="2"/>'
STATIC_LID = '<geom name="lid" type="box" pos="0 0 {z}" size="1 1 .1"/>'


def build(world, rest="", *, gravity="0 0 0", integrator="Euler"):
    option = f'timestep="{H}" integrator="{integrator}" gravity="{gravity}"'
    return scenes.compiled(world, rest, option=option, geom='condim="1"')


def slider(name, x, mass, *, axes=("1 0 0",), size=0.1):
    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in axes)
    geom = f'<geom name="{name}" type="sphere" size="{size}" mass="{mass}"/>'
    return f'<body pos="{x}">{joints}{geom}</body>'


def pushed(model, data):
    """Step once with nothing that moves; the configuration is then the one that was pushed out."""
    stepper = Stepper(model, Moreau(0.5), overlap="push-out")
    stepper.step(data)
    assert stepper.events == ()
    return stepper


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_ball_in_the_floor_moves_up_and_keeps_its_velocity(integrator):
    model, data = build(FLOOR + f'<body pos="0 0 .09"><freejoint/>{BALL}</body>', integrator=integrator)
    data.qvel[:] = 0.3, -0.2, 0.0, 0.0, 0.0, 0.5
    before = data.qvel.copy()
    pushed(model, data)
    np.testing.assert_allclose(data.qpos[:3], [0.3 * H, -0.2 * H, 0.1], atol=1e-11)
    np.testing.assert_allclose(data.qvel, before, atol=1e-12)
    assert data.time == H


def test_a_ball_that_approaches_collides_where_it_was_pushed_to():
    model, data = build(FLOOR + f'<body pos="0 0 .09"><freejoint/>{BALL}</body>')
    data.qvel[2] = -1.0
    stepper = Stepper(model, Moreau(0.5), overlap="push-out")
    stepper.step(data)
    (event,) = stepper.events
    assert event.time == 0.0
    assert event.qpos[2] == pytest.approx(0.1, abs=1e-11)
    assert data.qpos[2] == pytest.approx(0.1 + 0.5 * H, abs=1e-11)


def test_a_gap_that_closes_in_the_same_step_is_located_from_where_it_was_pushed_to():
    model, data = build(FLOOR + STATIC_LID.format(z=0.301) + slider("ball", "0 0 .09", 1, axes=("0 0 1",)))
    data.qvel[0] = 1.0
    stepper = Stepper(model, Moreau(0.5), overlap="push-out")
    stepper.step(data)
    (event,) = stepper.events
    assert event.time == pytest.approx(0.001, abs=1e-9)
    np.testing.assert_allclose(data.qpos, [0.01 + 0.001 - 0.5 * 0.001], atol=1e-9)


def test_a_box_in_a_corner_moves_out_of_all_three_faces_and_does_not_turn():
    walls = '<geom type="plane" size="5 5 .1" zaxis="1 0 0"/><geom type="plane" size="5 5 .1" zaxis="0 1 0"/>'
    box = '<body pos=".19 .27 .35"><freejoint/><geom type="box" size=".2 .3 .4"/></body>'
    model, data = build(FLOOR + walls + box)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.2, 0.3, 0.4, 1, 0, 0, 0], atol=1e-10)


def test_a_box_pressed_in_by_an_edge_lands_on_that_edge():
    """A box about one horizontal axis: shift z and turn so that its lowest edge is at height 0, at least cost."""
    box = """<body pos="0 0 .26"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
             <geom type="box" size=".2 .3 .2" mass="1"/></body>"""
    model, data = build(FLOOR + box)
    inertia = 1.0 * (0.4**2 + 0.4**2) / 12
    data.qpos[1] = np.radians(30)
    pushed(model, data)
    z, angle = data.qpos

    def height(angle):  # of the lowest edge over the center's height
        return -0.2 * np.sqrt(2.0) * np.cos(np.pi / 4 - angle)

    def slope(angle):
        return (height(angle + 1e-6) - height(angle - 1e-6)) / 2e-6

    turn = angle - np.radians(30)
    assert 0.26 + z + height(angle) == pytest.approx(0.0, abs=1e-9)
    assert inertia * turn == pytest.approx(z * slope(angle), rel=1e-6)  # the shift is along M^-1 J^T
    assert z > 0.005
    assert abs(turn) > 0.01


@pytest.mark.parametrize(("light", "heavy"), [(1.0, 1.0), (1.0, 3.0), (1e-6, 1e6)])
def test_two_balls_share_the_shift_by_mass(light, heavy):
    model, data = build(slider("a", "0 0 0", light) + slider("b", ".17 0 0", heavy))
    pushed(model, data)
    total = light + heavy
    np.testing.assert_allclose(data.qpos, [-0.03 * heavy / total, 0.03 * light / total], atol=1e-11)


def test_curved_surfaces_part_along_their_common_normal():
    plane = ("1 0 0", "0 0 1")
    model, data = build(slider("a", "0 0 0", 1, axes=plane) + slider("b", ".06 0 .08", 4, axes=plane))
    pushed(model, data)
    normal = np.array([0.6, 0.8])
    np.testing.assert_allclose(data.qpos, np.concatenate([-0.08 * normal, 0.02 * normal]), atol=1e-10)


def test_who_is_behind_is_pushed_along_and_a_wall_is_not():
    wall = '<geom type="plane" size="5 5 .1" pos="-.1 0 0" zaxis="1 0 0"/>'
    row = "".join(slider(name, f"{x} 0 0", 1) for name, x in (("a", 0.0), ("b", 0.15), ("c", 0.36)))
    model, data = build(wall + row)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.0, 0.05, 0.04], atol=1e-11)


def test_joints_beyond_their_limits_come_back_to_them():
    model, data = build(
        '<body><joint type="slide" axis="1 0 0" limited="true" range="-1 2"/><geom size=".1" mass="1"/></body>'
        '<body pos="0 9 0"><joint axis="0 1 0" limited="true" range="-30 45"/><geom size=".1" pos="1 0 0"/></body>'
    )
    data.qpos[:] = 2.25, np.radians(-31)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [2.0, np.radians(-30)], atol=1e-11)


def test_a_limit_between_two_bodies_keeps_their_center_of_mass():
    model, data = build(
        '<body><joint type="slide" axis="1 0 0"/><geom size=".1" mass="3"/><body pos="1 0 0">'
        '<joint type="slide" axis="1 0 0" limited="true" range="0 .5"/><geom size=".1" mass="1"/></body></body>'
    )
    data.qpos[:] = 0.0, 0.7
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.2 * 1 / 4, 0.5], atol=1e-11)


def test_a_tendon_beyond_its_limit_is_shared_by_its_joints():
    rest = (
        '<tendon><fixed limited="true" range="-1 1"><joint joint="a" coef="1"/>'
        '<joint joint="b" coef="2"/></fixed></tendon>'
    )
    body = '<body pos="0 {y} 0"><joint name="{n}" type="slide" axis="1 0 0"/><geom size=".1" mass="{m}"/></body>'
    model, data = build(body.format(y=0, n="a", m=1) + body.format(y=1, n="b", m=4), rest)
    data.qpos[:] = 1.0, 0.2
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [1.0 - 0.2, 0.2 - 0.1], atol=1e-11)  # d = -M^-1 (1, 2) 0.4 / (1 + 4/4)


def test_equality_constraints_hold_while_bodies_are_pushed():
    rest = '<equality><joint joint1="left" joint2="right"/></equality>'
    body = """<body pos="{x} 0 {z}"><joint name="{n}" type="slide" axis="0 0 1"/>
              <geom type="sphere" size=".1" mass="{m}"/></body>"""
    model, data = build(FLOOR + body.format(x=0, z=0.08, n="left", m=1) + body.format(x=1, z=0.3, n="right", m=5), rest)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.02, 0.02], atol=1e-9)


@pytest.mark.parametrize(
    ("world", "named"),
    [
        (FLOOR + STATIC_LID.format(z=0.28) + slider("ball", "0 0 .09", 1, axes=("0 0 1",)), "floor/ball by 0.01 m"),
        (FLOOR + slider("ball", "0 0 .07", 1), "floor/ball by 0.03 m"),  # it cannot move that way
    ],
)
def test_squeezed_bodies_are_refused_and_left_as_they_were(world, named):
    model, data = build(world)
    data.qvel[0] = 0.25
    stepper = Stepper(model, Moreau(1), overlap="push-out", on_unsolved="raise")
    with pytest.raises(OverlapError, match=rf"{named}.*squeezed"):
        stepper.step(data)
    np.testing.assert_array_equal(data.qpos, [0.0])
    np.testing.assert_array_equal(data.qvel, [0.25])
    assert data.time == 0.0
    stepper = Stepper(model, Moreau(1), overlap="push-out")
    for _ in range(10):
        stepper.step(data)
    assert stepper.unlocated == 10  # time stepping opens what it can


def test_a_lid_that_can_move_gives_way():
    """The ball is squeezed by 1 cm into the floor and by 1 cm into the lid: it moves up 1 cm, and the lid 2 cm."""
    lid = """<body pos="0 0 .28"><joint type="slide" axis="0 0 1"/>
             <geom name="lid" type="box" size="1 1 .1" mass="7"/></body>"""
    model, data = build(FLOOR + slider("ball", "0 0 .09", 1, axes=("0 0 1",)) + lid)
    pushed(model, data)
    np.testing.assert_allclose(data.qpos, [0.01, 0.02], atol=1e-10)


def test_it_is_pushed_out_again_after_a_reset_only():
    model, data = build(FLOOR + f'<body pos="0 0 .09"><freejoint/>{BALL}</body>', gravity="0 0 -9.81")
    stepper = pushed(model, data)
    start = data.qpos.copy()
    for _ in range(10):
        stepper.step(data)
    np.testing.assert_allclose(data.qpos, start, atol=1e-11)
    mujoco.mj_resetData(model, data)
    stepper.step(data)
    np.testing.assert_allclose(data.qpos, start, atol=1e-11)
    data.qpos[2] = 0.05
    stepper.step(data)
    np.testing.assert_allclose(data.qpos, start, atol=1e-11)


def test_without_overlap_the_option_changes_nothing():
    model, data = build(FLOOR + f'<body pos="0 0 .1"><freejoint/>{BALL}</body>', gravity="1 0 -9.81")
    other = mujoco.MjData(model)
    data.qvel[:] = other.qvel[:] = 0.1, 0.2, 3.0, 0.1, 0.2, 0.3
    steppers = Stepper(model, Moreau(0.5), overlap="push-out"), Stepper(model, Moreau(0.5))
    for _ in range(400):
        steppers[0].step(data)
        steppers[1].step(other)
    np.testing.assert_array_equal(data.qpos, other.qpos)
    np.testing.assert_array_equal(data.qvel, other.qvel)


def test_the_option_has_two_values():
    model, _ = build(FLOOR)
    with pytest.raises(UnknownNameError, match="push-out"):
        Stepper(model, Moreau(1), overlap="push")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", ["Hopper-v5", "Walker2d-v5", "Humanoid-v5", "HalfCheetah-v5"])
def test_resets_of_gymnasium_start_on_rigid_contact(name):
    env = gymnasium.make(name).unwrapped
    model, data = env.model, env.data  # pyright: ignore[reportAttributeAccessIssue]
    stepper = Stepper(model, Moreau(0.5), friction="ignore", overlap="push-out", on_inadmissible="project")
    refused = 0
    for seed in range(20):
        env.reset(seed=seed)
        refused += read_contacts(model, data).gap.min(initial=0.0) < -1e-9
        stepper.step(data)
        assert read_contacts(model, data).gap.min(initial=0.0) > -2e-9
    assert refused > 0


@pytest.mark.parametrize("name", ["Hopper-v5", "Humanoid-v5"])
def test_environments_of_others_run_on_rigid_contact_from_their_own_resets(name):
    env = ImpactLaw(gymnasium.make(name), law="moreau", restitution=0.5, contact_model="rigid")
    env.action_space.seed(0)
    for seed in range(5):
        env.reset(seed=seed)
        for _ in range(3):
            *_, info = env.step(env.action_space.sample())
            assert not info["impact/diverged"]
    env.close()


@pytest.mark.parametrize(("shape", "least"), [("sphere", 0.0), ("box", 0.0), ("ellipsoid", -1e-12)])
def test_a_heap_thrown_into_itself_is_pulled_apart(shape, least):
    """Free bodies overlap each other and the floor by up to their own size; all gaps are open afterwards."""
    rng = np.random.default_rng(5)
    bodies = ""
    for position, turn in zip(rng.uniform(-0.1, 0.1, (5, 3)), rng.uniform(-180, 180, (5, 3)), strict=True):
        x, y, z = position
        bodies += f'<body pos="{x} {y} {z + 0.15}" euler="{turn[0]} {turn[1]} {turn[2]}"><freejoint/>'
        bodies += f'<geom type="{shape}" size=".1 .08 .06"/></body>'
    model, data = build(FLOOR + bodies)
    assert read_contacts(model, data).gap.min() < -0.05
    pushed(model, data)
    assert read_contacts(model, data).gap.min(initial=0.0) >= least - 2e-9


@pytest.mark.parametrize("squeezed", [False, True])
def test_a_gap_that_jumps_in_a_phase_is_opened_unless_bodies_are_squeezed(squeezed, monkeypatch):
    """The phase is told to have ended 1e-7 m deeper than it did, as a contact point that jumps on a face ends it."""
    model, data = build(FLOOR + '<body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>')
    advance, jumped = SmoothPhases.advance_to_contact, []

    def advance_deeper(self, *args, **kwargs):
        trial, closed = advance(self, *args, **kwargs)
        if jumped:
            return trial, closed
        jumped.append(1)
        data.qpos[0] = -1e-7
        self.configuration.update()
        phase_end = trial.phase_end._replace(now=self.look())
        return trial._replace(phase_end=phase_end, gap=-1e-7), True

    def refuse(phases, start):
        data.qpos[0] = 1.0
        raise OverlapError("bodies are squeezed there")

    monkeypatch.setattr(SmoothPhases, "advance_to_contact", advance_deeper)
    if squeezed:
        monkeypatch.setattr(rigid, "push_out", refuse)
    Stepper(model, Moreau(0.5)).step(data)
    assert jumped
    assert data.qpos[0] == pytest.approx(-1e-7 if squeezed else 0.0, abs=1e-9)


def test_joints_are_put_back_to_their_limits_where_no_smallest_shift_is_found(monkeypatch):
    """As for a hand whose thumb starts beyond its limit, with fingers in the way of any smaller shift."""

    def squeezed(*args):
        raise UnfinishedStepError("too much work")

    monkeypatch.setattr("impactlaw.stepping.event_driven.overlap._smallest_shift", squeezed)
    xml = """<mujoco><worldbody><body><joint type="hinge" axis="0 1 0" range="15 60" limited="true"/>
      <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/>
      <body pos=".1 0 0"><joint type="slide" axis="1 0 0" range="-.1 .1" limited="true"/><geom size=".01"/></body>
      </body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[1] = 0.05
    stepper = Stepper(model, MaximalDissipation(), overlap="push-out")
    stepper.step(data)
    assert stepper.unlocated == 0
    np.testing.assert_allclose(data.qpos, [np.deg2rad(15), 0.05], atol=1e-3)
