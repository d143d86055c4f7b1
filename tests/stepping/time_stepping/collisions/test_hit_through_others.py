"""Contacts that another collision closes in the same step have their restitution."""

import mujoco
import numpy as np
import pytest

from impactlaw import Batch, Moreau, Newton, Stepper
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY, raw
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import TOLERANCE

BY_PAIR = Newton({("b0", "b1"): 0.5, ("b1", "b2"): 0.5}, default=0.9)


def line(gaps, option='gravity="0 0 0"'):
    """Return balls of radius 0.1 and 1 kg on a line, the first two separated by gaps[0]."""
    places = np.concatenate([[0.0], np.cumsum(0.2 + np.array(gaps))])
    balls = "".join(
        f'<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/><geom name="b{i}" size=".1" mass="1"/></body>'
        for i, x in enumerate(places)
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep=".002" {option}/><worldbody>{balls}</worldbody></mujoco>'
    )


def watched(model, law, look):
    """Return a stepper that passes its contact problems to a function, and the memory of its steps."""
    stepper = Stepper(model, law, scheme="time-stepping")
    stepper.stepping.watch(look)
    return stepper, stepper.stepping.numbers


def box(count, rng):
    """Return balls in a box without gravity."""
    walls = "".join(
        f'<geom type="plane" size="1 1 1" pos="{-0.4 * x} {-0.4 * y} {-0.4 * z}" zaxis="{x} {y} {z}" condim="1"/>'
        for x, y, z in np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    )
    balls = "".join(
        f'<body pos="{0.25 * (i % 3) - 0.25} {0.25 * (i // 3) - 0.25} 0"><freejoint/>'
        '<geom size=".1" mass="1" condim="1"/></body>'
        for i in range(count)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0"/><worldbody>{walls}{balls}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel.reshape(-1, 6)[:, :3] = 3.0 * rng.normal(size=(count, 3))
    return model, data


def one_after_another(velocity, e, pairs):
    """Return the velocities after collisions of equal balls, pair by pair."""
    v = np.array(velocity, dtype=float)
    for i in pairs:
        mean, apart = 0.5 * (v[i] + v[i + 1]), e * (v[i] - v[i + 1])
        v[i : i + 2] = mean - 0.5 * apart, mean + 0.5 * apart
    return v


@pytest.mark.parametrize("gap", [2e-5, 1e-4, 5e-4])
def test_a_cradle_with_gaps_passes_the_velocity_on(gap):
    model = line([gap] * 4)
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
    for _ in range(5):
        stepper.step(data)
    assert data.qvel == pytest.approx([0, 0, 0, 0, 1], abs=1e-9)


@pytest.mark.parametrize(("law", "compiled"), [(Moreau(0.5), "auto"), (BY_PAIR, "auto"), (BY_PAIR, "never")])
def test_every_collision_of_a_sequence_has_its_restitution(law, compiled):
    """The second pair is hit in the same step as the first one, which is then hit again from behind."""
    model = line([2e-5, 2e-5])
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    stepper = Stepper(model, law, scheme="time-stepping", compiled=compiled)
    stepper.step(data)
    assert data.qvel == pytest.approx(one_after_another([1, 0, 0], 0.5, [0, 1, 0]), abs=1e-9)
    pairs = [event.contacts.labels for event in stepper.events]
    assert pairs == [("b0/b1",), ("b1/b2",), ("b0/b1",)]
    for event, after in zip(stepper.events, stepper.events[1:], strict=False):
        assert after.impact.collision.pre_velocity == pytest.approx(event.impact.post_velocity, abs=1e-12)


def test_an_elastic_gas_keeps_its_energy():
    model, data = box(9, np.random.default_rng(0))
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
    energy, several = data.qvel @ data.qvel, 0
    for _ in range(1500):
        stepper.step(data)
        several += len(stepper.events) > 1
    assert data.qvel @ data.qvel == pytest.approx(energy, rel=1e-9)
    assert several > 3  # otherwise the test has no effect


def test_a_gas_loses_what_its_collisions_tell():
    """Nothing else changes its energy, and walls and balls take part in several collisions of a step."""
    model, data = box(9, np.random.default_rng(1))
    stepper, several = Stepper(model, Moreau(0.9), scheme="time-stepping"), 0
    for _ in range(800):
        before = data.qvel @ data.qvel
        stepper.step(data)
        told = 2.0 * sum(event.impact.energy_change for event in stepper.events)
        assert data.qvel @ data.qvel - before == pytest.approx(told, abs=1e-10 * before)
        several += len(stepper.events) > 1
    assert several > 3


def between(ratio, places):
    """Return a ball of 1 kg between a wall and a ball of `ratio` kg."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".01" gravity="0 0 0" integrator="RK4"/><default><geom condim="1"/></default>
        <worldbody><geom type="plane" size="1 1 1" zaxis="1 0 0"/>
        <body pos="{places[0]} 0 .5"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
        <body pos="{places[1]} 0 .5"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="{ratio}"/></body>
        </worldbody></mujoco>"""
    )


@pytest.mark.parametrize(("ratio", "some"), [(16, False), (100, False), (1000, True), (1e4, True), (1e6, True)])
def test_restitution_that_is_left_out_is_counted_and_loses_no_energy(ratio, some):
    """Galperin's billiard: pi sqrt(m / M) collisions, of which a step can resolve only some in sequence."""
    model = between(ratio, (0.3, 0.8))
    data = mujoco.MjData(model)
    data.qvel[1] = -1.0
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
    for _ in range(100):
        stepper.step(data)
    kept = (data.qvel[0] ** 2 + ratio * data.qvel[1] ** 2) / ratio
    assert (stepper.short_steps > 0) == some
    assert kept == pytest.approx(1.0, rel=3e-8 if some else 1e-12)
    assert data.qvel[1] > 0.97


@pytest.mark.parametrize("ratio", [1e3, 1e4, 1e5, 1e6])
@pytest.mark.parametrize("gaps", [(2e-5, 2e-5), (4e-4, 8e-5), (7.6e-5, 8e-4)])
def test_a_light_ball_between_a_wall_and_a_heavy_one(ratio, gaps):
    """It would bounce too often within a step: the share of restitution is found that conserves energy.

    With a guess far from the solution, this can look like bodies that jam.
    """
    model = between(ratio, (0.1 + gaps[0], 0.3 + gaps[0] + gaps[1]))
    data = mujoco.MjData(model)
    data.qvel[0] = -1.0
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping")
    stepper.step(data)
    assert data.qvel[0] ** 2 + ratio * data.qvel[1] ** 2 == pytest.approx(1.0, rel=1e-6)


def billiard(masses, reach, timestep):
    """Return disks without friction between four walls at the same distance from the middle."""
    walls = "".join(
        f'<geom type="plane" size="1 1 .1" pos="{reach * x} {reach * y} 0" zaxis="{-x} {-y} 0"/>'
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    disks = "".join(
        '<body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
        f'<geom size=".05" mass="{mass}"/></body>'
        for mass in masses
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}" gravity="0 0 0"/><default><geom friction="0"/></default>'
        f"<worldbody>{walls}{disks}</worldbody></mujoco>"
    )


@pytest.mark.parametrize("law", [Moreau(1.0), Newton({}, default=1.0)])
@pytest.mark.parametrize(
    ("masses", "timestep"), [([1] * 4, 0.002), ([1] * 4, 0.01), ([0.1, 1, 3, 10], 0.002), ([1, 100], 0.002)]
)
def test_elastic_billiards_keep_their_energy(law, masses, timestep):
    """Disks jammed between others and the walls collide dozens of times within a step.

    Impulses are found to `TOLERANCE`: disks of 0.1 kg at 50 m/s between those of 10 kg lose 1e-11 in a collision. In
    one of 32 000 steps disks may collide more often than a step allows (`PHASES`): it is short, and loses energy.
    """
    model = billiard(masses, 0.2, timestep)
    batch, rng = Batch(model, law, 32, 1), np.random.default_rng(0)
    qvel = batch.bind("qvel")
    qvel[:] = 2.0 * rng.normal(size=qvel.shape)
    corners = np.array([(-0.08, -0.07), (0.06, 0.08), (0.07, -0.06), (-0.07, 0.06)])
    batch.bind("qpos")[:] = corners[: len(masses)].ravel()
    before = qvel**2 @ np.repeat(masses, 2)
    batch.step(nstep=1000)
    assert batch.impact_count.min() > 30
    kept = batch.short_steps == 0
    assert batch.short_steps.sum() <= 1
    np.testing.assert_allclose((qvel**2 @ np.repeat(masses, 2))[kept], before[kept], rtol=TOLERANCE)


@pytest.mark.parametrize("inadmissible", ["project", "raise", "allow"])
def test_a_third_collision_of_a_step_that_the_second_one_leads_to(inadmissible):
    """A disk hits another, is thrown at a wall, and returns: held by this contact alone, it would create energy."""
    model = billiard((1.3, 1.9), 0.4, 0.01)
    data, mass = mujoco.MjData(model), np.repeat([1.3, 1.9], 2)
    data.qpos[:] = [0.15413107, -0.33467055, 0.09136956, -0.22399240]
    data.qvel[:] = [-1.84697450, 0.72284809, 0.32397793, -1.43798958]
    before = mass @ data.qvel**2
    stepper = Stepper(model, Moreau(1.0), scheme="time-stepping", on_inadmissible=inadmissible)
    stepper.step(data)
    assert len(stepper.events) == 3
    assert stepper.short_steps == 0
    assert mass @ data.qvel**2 == pytest.approx(before, rel=1e-11)


@pytest.mark.parametrize(("left", "apart"), [(0.6, True), (0.4, False)])
def test_collisions_are_one_after_another_if_more_than_half_of_the_work_is_left(left, apart):
    """They take several times the work of the first solve: a step that has spent much already would take too long."""

    def spend(problem: object) -> None:
        numbers[MEMORY.work] = min(numbers[MEMORY.work], left)

    model = line([2e-5, 2e-5])
    data = mujoco.MjData(model)
    data.qvel[:] = 0.5, -0.5, -0.5  # no ball is thrown beyond the margin of detection
    stepper, numbers = watched(model, Moreau(0.5), spend)
    stepper.step(data)
    assert (len(stepper.events), stepper.short_steps) == ((3, 0) if apart else (1, 1))


def test_looking_farther_leaves_work_for_the_collisions_of_a_row():
    """Twenty elastic balls, each of which is hit several times per step, throw each other far."""
    model = line([1e-3] * 19)
    for seed in range(12):
        data = mujoco.MjData(model)
        data.qvel[:] = np.random.default_rng(seed).normal(size=20)
        before = data.qvel @ data.qvel
        Stepper(model, Moreau(1.0), scheme="time-stepping").step(data)
        assert data.qvel @ data.qvel == pytest.approx(before, rel=1e-9)


@pytest.mark.parametrize("seed", [3, 6])
def test_contacts_of_a_face_are_left_out_together(seed):
    """If they were left out one by one, each would hold the box as the previous one did."""
    turn = np.array([1.0, *(2e-3 * np.random.default_rng(seed).normal(size=3))])
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0"/><worldbody>'
        '<body pos="-.2001 0 0"><freejoint/><geom size=".1" mass="1"/></body>'
        '<body><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>'
        '<body pos=".2008 .03 .02"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[17:21] = turn / np.linalg.norm(turn)
    data.qvel[0] = 1.0
    sizes = []
    stepper, _ = watched(model, Moreau(0.5), lambda problem: sizes.append(len(problem.rows.key)))
    stepper.step(data)
    assert len(stepper.events) == 2
    assert max(sizes) > 3
    assert not [one for one in zip(sizes, sizes[1:], sizes[2:], strict=False) if one[0] > one[1] > one[2]], sizes


def test_after_collisions_one_after_another_no_turn_is_known():
    """The last collision has only some of the contacts; the step does not end with the targets of the first one."""
    model, sizes = line([0.001, 0.0015]), []
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    stepper, numbers = watched(model, Moreau(1.0), lambda problem: sizes.append(len(problem.rows.key)))
    stepper.step(data)
    assert {1, 2} <= set(sizes)
    groups, n = numbers.view(np.int64)[MEMORY.groups : MEMORY.rows + 1]
    assert groups == 2
    _, impulses, turns = np.split(np.frombuffer(raw(numbers)[8 * groups :][: 32 * n]), [n, 2 * n])
    assert np.count_nonzero(impulses) == 2
    assert np.isnan(turns).all()
