"""Overlap that is refused, overlap that movable bodies resolve, and overlap after resets of environments."""

import gymnasium
import mujoco
import numpy as np
import pytest
from stepping.event_driven.overlap.built import BALL, STATIC_LID, build, pushed, slider

from impactlaw import MaximalDissipation, Moreau, Stepper, read_contacts
from impactlaw.envs import ImpactLaw
from impactlaw.errors import OverlapError, UnfinishedStepError, UnknownNameError
from impactlaw.stepping.event_driven import overlap
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases

FLOOR = '<geom name="floor" type="plane" size="5 5 .1"/>'


@pytest.mark.parametrize(
    ("world", "named"),
    [
        (FLOOR + STATIC_LID.format(z=0.28) + slider("ball", "0 0 .09", 1, axes=("0 0 1",)), "floor/ball by 0.01 m"),
        (FLOOR + slider("ball", "0 0 .07", 1), "floor/ball by 0.03 m"),  # it cannot move upwards
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
    assert stepper.unlocated == 10  # time stepping opens overlap as far as possible


def test_a_lid_that_can_move_gives_way():
    """The ball overlaps the floor by 1 cm and the lid by 1 cm: it moves up by 1 cm, and the lid by 2 cm."""
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
    """Free bodies overlap each other and the floor by up to their own size; afterwards all gaps are open."""
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
    """The phase is made to end 1e-7 m deeper, as if a contact point jumped on a face."""
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
        monkeypatch.setattr(overlap, "push_out", refuse)
    Stepper(model, Moreau(0.5)).step(data)
    assert jumped
    assert data.qpos[0] == pytest.approx(-1e-7 if squeezed else 0.0, abs=1e-9)


def test_joints_are_put_back_to_their_limits_where_no_smallest_shift_is_found(monkeypatch):
    """As for a hand whose thumb starts beyond its limit, with fingers that block any smaller shift."""

    def squeezed(*args):
        raise UnfinishedStepError("too much work")

    monkeypatch.setattr("impactlaw.stepping.event_driven.overlap._smallest_shift", squeezed)
    xml = """<mujoco><worldbody><body><joint type="hinge" axis="0 1 0" range="15 60" limited="true"/>
      <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/>
      <body pos=".1 0 0"><joint type="slide" axis="1 0 0" range="-.1 .1" limited="true"/><geom size=".01"/></body>
      </body><body pos="0 1 0"><joint type="hinge" axis="0 1 0"/><geom size=".01"/></body>
      </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0, 0.05, 1.0
    stepper = Stepper(model, MaximalDissipation(), overlap="push-out")
    stepper.step(data)
    assert stepper.unlocated == 0
    np.testing.assert_allclose(data.qpos, [np.deg2rad(15), 0.05, 1.0], atol=1e-3)  # the last has no limit
