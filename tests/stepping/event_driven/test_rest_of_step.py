"""What event-driven steps leave undone is time stepped: no exceptions, bounded work, and counted."""

from __future__ import annotations

import copy
import pickle
import warnings

import mujoco
import numpy as np
import pytest
from dm_control import suite

from impactlaw import MaximalDissipation, Moreau, Stepper
from impactlaw.envs.info import steps_short
from impactlaw.errors import ManyCollisionsWarning, SceneError, SolverError, UnfinishedStepError
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases
from impactlaw.stepping.work import Work

FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'
BOX = '<body pos="0 0 .1"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="1"/></body>'


def compiled(bodies: str, option: str = 'timestep="0.002"') -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><option {option}/><worldbody>{bodies}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


def billiard(ratio: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Galperin's billiard: a heavy ball drives a light one against a wall, which it hits pi times sqrt(ratio)."""
    balls = f"""<geom type="plane" size="5 5 .1" zaxis="1 0 0"/>
      <body pos=".2 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
      <body pos=".5 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="{ratio}"/></body>"""
    model, data = compiled(balls, 'timestep="0.01" gravity="0 0 0"')
    data.qvel[1] = -1.0
    return model, data


def unsolved(*args, **kwargs):
    raise SolverError("no impulses were found")


def test_friction_without_certified_impulses_is_time_stepped(monkeypatch):
    model, data = compiled(FLOOR + BOX)
    data.qvel[0] = 1.0
    stepper, strict = Stepper(model, Moreau(0.0)), Stepper(model, Moreau(0.0), on_unsolved="raise")
    monkeypatch.setattr("impactlaw.stepping.event_driven.persistent_contact.frictional.solve_cone_rows", unsolved)
    with pytest.raises(SolverError):
        strict.step(copy.copy(data))
    for _ in range(50):
        stepper.step(data)
    assert stepper.unlocated == 50
    assert data.time == pytest.approx(0.1)
    assert data.qvel[0] == pytest.approx(1.0 - 9.81 * 0.1, abs=1e-6)
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-8)


def test_a_collision_without_a_solution_is_time_stepped_from_where_it_was(monkeypatch):
    model, data = compiled(FLOOR + BOX.replace("0 0 .1", "0 0 .101"), 'timestep="0.01"')
    data.qvel[2] = -1.0
    stepper = Stepper(model, Moreau(0.5))
    monkeypatch.setattr("impactlaw.stepping.collisions.Collider.collide", unsolved)
    stepper.step(data)
    assert stepper.unlocated == 1
    assert len(stepper.events) == 1
    assert data.qvel[2] == pytest.approx(0.5, abs=0.1)


def test_on_a_belt_the_rest_of_a_step_is_time_stepped_too(monkeypatch):
    model, data = compiled(FLOOR.replace("/>", ' surfacevel="1 0 0 0 0 0"/>') + BOX)
    stepper = Stepper(model, Moreau(0.0))
    monkeypatch.setattr("impactlaw.stepping.event_driven.persistent_contact.frictional.solve_cone_rows", unsolved)
    for _ in range(100):
        stepper.step(data)
        assert data.qvel[0] == pytest.approx(min(9.81 * data.time, 1.0), abs=1e-6)
    assert stepper.unlocated == 100
    assert data.qpos[2] == pytest.approx(0.1, abs=1e-8)


def test_an_episode_does_not_depend_on_steps_that_were_not_finished_in_one_before(monkeypatch):
    model, data = compiled(FLOOR + BOX)
    used, fresh = Stepper(model, Moreau(0.5)), Stepper(model, Moreau(0.5))
    with monkeypatch.context() as hard:
        hard.setattr("impactlaw.stepping.event_driven.persistent_contact.frictional.solve_cone_rows", unsolved)
        for _ in range(50):
            used.step(data)
    assert used.unlocated == 50
    ends = []
    for stepper in used, fresh:
        mujoco.mj_resetData(model, data)
        data.qpos[2], data.qvel[:3] = 0.101, (1.0, 0.0, -1.0)
        stepper.step(data)
        assert len(stepper.events) == 1
        ends.append(data.qpos.copy())
    assert used.unlocated == 50
    assert np.array_equal(*ends)


def test_after_a_step_that_was_not_finished_more_and_more_are_left_to_time_stepping(monkeypatch):
    model, data = compiled(FLOOR + BOX)
    tried, advance = [], SmoothPhases.advance_to_contact

    def counted(self, *args, **kwargs):
        tried.append(1)
        if len(tried) < 6:
            raise UnfinishedStepError("too much")
        return advance(self, *args, **kwargs)

    monkeypatch.setattr(SmoothPhases, "advance_to_contact", counted)
    stepper = Stepper(model, Moreau(0.0))
    for _ in range(40):
        data.qvel[0] = 1.0
        stepper.step(data)
    assert stepper.unlocated == 5 + 0 + 0 + 1 + 2 + 4
    assert len(tried) == 5 + 40 - stepper.unlocated


def test_many_collisions_are_told_once_and_keep_their_energy():
    model, data = billiard(1e4)
    stepper = Stepper(model, Moreau(1.0))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for _ in range(60):
            stepper.step(data)
    assert [warning.category for warning in told] == [ManyCollisionsWarning]
    assert "max_events" in str(told[0].message)
    assert stepper.unlocated > 0
    assert data.qvel @ (data.qvel * [1.0, 1e4]) == pytest.approx(1e4, rel=0.01)


def test_many_collisions_are_located_where_that_is_asked_for():
    model, data = billiard(1e6)
    stepper, collisions = Stepper(model, Moreau(1.0), max_events=10_000), 0
    for _ in range(60):
        stepper.step(data)
        collisions += len(stepper.events)
    assert collisions == 3141
    assert stepper.unlocated == 0


DOMINO = '<body pos="{} 0 .089"><freejoint/><geom type="box" size=".008 .044 .089" mass=".09"/></body>'


@pytest.mark.filterwarnings("ignore::impactlaw.errors.ManyCollisionsWarning")
def test_contacts_that_a_force_opens_may_be_the_first_ones_of_a_step():
    """The step is cut where nothing is in contact, while the force of the persistent contacts before it is known."""
    model, data = compiled(FLOOR + DOMINO.format(0) + DOMINO.format(0.1), 'timestep="0.02"')
    data.qvel[:] = 3.0 * np.random.default_rng(3).normal(size=model.nv)
    stepper = Stepper(model, Moreau(0.0), max_events=1)
    for _ in range(8):
        stepper.step(data)
    depth = -data.contact.dist.min(initial=0.0)
    assert depth <= 1e-5
    assert np.isfinite(data.qpos).all()


@pytest.mark.filterwarnings("ignore::impactlaw.errors.ManyCollisionsWarning")
@pytest.mark.parametrize("timestep", [0.01, 0.003, 0.001])
@pytest.mark.parametrize("ratio", [1e4, 1e6])
def test_a_ball_between_a_wall_and_a_ball_passes_through_neither(ratio: float, timestep: float):
    """Collisions make the ball so fast that half a step moves it farther than its size."""
    model, data = billiard(ratio)
    model.opt.timestep = timestep
    data.qpos[:] = 0.8, 1.5
    stepper, short, nearest = Stepper(model, Moreau(1.0)), [0], []
    for _ in range(round(2.2 / timestep)):
        stepper.step(data)
        wall, ball = 0.1 + data.qpos[0], 0.1 + data.qpos[1] - data.qpos[0]
        nearest.append(min(wall, ball))
        short.append(stepper.short_steps)
    assert min(nearest) > -1e-9
    assert np.diff(short).max() <= 1


def test_a_fast_ball_bounces_on_a_thin_table_that_rises_in_what_is_time_stepped(monkeypatch):
    plate = '<body mocap="true"><geom type="box" size="1 1 .01" pos="0 0 -.01"/></body>'
    ball = '<body pos="0 0 .71"><joint type="slide" axis="0 0 1"/><geom size=".02" mass="1"/></body>'
    model, data = compiled(plate + ball, 'timestep="0.01" gravity="0 0 0"')
    data.qvel[0] = -20.0
    stepper, count = Stepper(model, Moreau(0.5)), 0
    for k in range(6):
        data.mocap_pos[0, 2] = k * 0.01  # at 1 m/s
        if k == 3:
            monkeypatch.setattr(SmoothPhases, "advance_to_contact", unsolved)
        stepper.step(data)
        count += len(stepper.events)
        assert 0.71 + data.qpos[0] - data.mocap_pos[0, 2] > 0.02 - 1e-9
    assert (count, stepper.unlocated) == (1, 3)
    assert data.qvel[0] == pytest.approx(1.0 + 0.5 * 21.0)


def test_a_table_goes_on_rising_in_what_remains_of_a_step(monkeypatch):
    table = '<body mocap="true"><geom type="box" size="1 1 .1" pos="0 0 -.1"/></body>'
    model, data = compiled(table + BOX)
    stepper, steps = Stepper(model, MaximalDissipation()), 0
    for k in range(100):
        data.mocap_pos[0, 2] = 0.2 * (k * 0.002) ** 2  # the first pose is the one it starts from
        with monkeypatch.context() as patch:
            if k >= 50:
                patch.setattr(SmoothPhases, "advance_to_contact", unsolved)
                steps += 1
            stepper.step(data)
        if k > 2:
            assert data.qpos[2] - data.mocap_pos[0, 2] == pytest.approx(0.1, abs=2e-6)
            assert data.qvel[2] == pytest.approx(0.4 * k * 0.002, abs=2e-3)
    assert stepper.unlocated == steps


@pytest.mark.filterwarnings("ignore::impactlaw.errors.ManyCollisionsWarning")
def test_work_is_counted_and_bounded(monkeypatch):
    """Boxes that fall on each other rattle; every run is the same on every machine."""
    spent, begin = [], Work.begin
    monkeypatch.setattr(Work, "begin", lambda self, *part: (spent.append(self._spent), begin(self, *part)))
    bodies = FLOOR + "".join(
        f'<body pos="{0.03 * i} 0 {0.15 + 0.21 * i}" euler="{7 * i} {11 * i} 0"><freejoint/>'
        '<geom type="box" size=".1 .1 .1"/></body>'
        for i in range(5)
    )
    ends = []
    for _ in range(2):
        model, data = compiled(bodies, 'timestep="0.005"')
        stepper = Stepper(model, Moreau(0.3), overlap="push-out")
        for _ in range(150):
            stepper.step(data)
        ends.append(np.append(data.qpos, stepper.unlocated))
    np.testing.assert_array_equal(*ends)
    assert ends[0][-1] > 0
    assert max(spent) < 150


def test_options_mean_something_to_event_driven_steps_only():
    model, _ = compiled(FLOOR + BOX)
    with pytest.raises(SceneError, match="on_unsolved"):
        Stepper(model, Moreau(0.5), scheme="time-stepping", on_unsolved="raise")


def without_room(monkeypatch):
    """Make MuJoCo run out of memory for constraint rows at the first call."""
    make, calls = mujoco.mj_makeConstraint, []

    def fail(model, data):
        calls.append(data.time)
        if len(calls) == 1:
            raise mujoco.FatalError("mj_stackAlloc: out of memory, stack overflow")
        make(model, data)

    monkeypatch.setattr(mujoco, "mj_makeConstraint", fail)


def test_where_mujoco_has_no_room_time_stepping_takes_the_step(monkeypatch):
    model, data = compiled(FLOOR + BOX)
    data.qvel[2] = -1.0
    stepper = Stepper(model, Moreau(0.5))
    without_room(monkeypatch)
    stepper.step(data)
    assert stepper.unlocated == 1
    assert data.qvel[2] == pytest.approx(0.5, abs=0.02)


def test_where_mujoco_has_no_room_a_step_can_raise(monkeypatch):
    model, data = compiled(FLOOR + BOX)
    data.qvel[2] = -1.0
    stepper = Stepper(model, Moreau(0.5), on_unsolved="raise")
    without_room(monkeypatch)
    with pytest.raises(UnfinishedStepError, match="no room for all contacts"):
        stepper.step(data)
    assert data.time == 0.0
    assert data.qvel[2] == -1.0
    stepper.step(data)
    assert data.qvel[2] == pytest.approx(0.5, abs=0.02)


def test_contacts_that_time_stepping_had_no_room_for_are_counted():
    boxes = "".join(BOX.replace('pos="0 0 .1"', f'pos="{x} {y} .1"') for x in range(10) for y in range(8))
    boxes = boxes.replace(' name="box"', "")
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><size memory="300K"/><worldbody>{FLOOR}{boxes}</worldbody></mujoco>'
    )
    for options in ({}, {"scheme": "time-stepping"}):
        data = mujoco.MjData(model)
        data.qvel[2::6] = -1.0
        stepper = Stepper(model, Moreau(0.5), **options)
        stepper.step(data)
        assert data.qvel[2::6].max() < -1.0  # they fall through the floor
        assert stepper.short_steps == 1
        assert steps_short(stepper) == 1


@pytest.mark.filterwarnings(
    "ignore::impactlaw.errors.UnreadSensorsWarning", "ignore::impactlaw.errors.ManyCollisionsWarning"
)
def test_a_quadruped_that_has_come_to_rest_is_event_driven_again():
    environment = suite.load("quadruped", "walk", task_kwargs={"random": 1})
    environment.reset()
    model, data = environment.physics.model.ptr, copy.copy(environment.physics.data.ptr)
    data.qpos[2] += 0.05
    stepper = Stepper(model, Moreau(0.0), scheme="event-driven", overlap="push-out")
    unlocated = []
    for _ in range(550):  # at rest from step 236 to 401 on, for drops that differ by 1 mm
        stepper.step(data)
        unlocated.append(stepper.unlocated)
    assert unlocated[300] > 0  # some steps are time stepped
    assert unlocated[450] == unlocated[-1]


def test_a_stepper_is_pickled_after_a_step_that_time_stepping_finished():
    balls = "".join(
        f'<body pos="{k} 0 {0.103 + 0.002 * k}"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>'
        for k in range(3)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="plane" size="5 5 1"/>{balls}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[:] = -4.0
    stepper = Stepper(model, Moreau(0.9), max_events=1)
    with pytest.warns(ManyCollisionsWarning):
        stepper.step(data)
    copied = pickle.loads(pickle.dumps(stepper))
    assert stepper.unlocated == 1
    assert len(copied.events) == len(stepper.events) > 0
    for own, other in zip(stepper.events, copied.events, strict=True):
        np.testing.assert_array_equal(own.impact.post_velocity, other.impact.post_velocity)


def test_constraints_that_drift_elsewhere_leave_collisions_located():
    """Regression: a coupling that gives way anywhere in the scene let a bouncing ball be time stepped."""
    arms = "".join(
        f'''<body pos="3 {i} 2"><joint name="{name}" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 {length} 0 0" size=".03" contype="0" conaffinity="0"/></body>'''
        for i, (name, length) in enumerate({"short": 0.3, "long": 0.5}.items())
    )
    coupling = '<equality><joint joint1="short" joint2="long" solref=".2 1"/></equality>'
    ball = '<body pos="0 0 1.1"><freejoint/><geom size=".1" mass="1" condim="1"/></body>'
    times = []
    for scene in (f"{FLOOR}{ball}</worldbody>", f"{FLOOR}{ball}{arms}</worldbody>{coupling}"):
        model = mujoco.MjModel.from_xml_string(f"<mujoco><option integrator='RK4'/><worldbody>{scene}</mujoco>")
        data, stepper, seen = mujoco.MjData(model), Stepper(model, Moreau(0.5)), []
        while data.time < 1.4:
            stepper.step(data)
            seen += [event.time for event in stepper.events]
        assert stepper.unlocated == 0
        times.append(seen)
    assert times[1] == pytest.approx(times[0], abs=1e-9)
    assert len(times[0]) == 15
