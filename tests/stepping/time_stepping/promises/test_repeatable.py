"""Equal runs are equal bit for bit; steppers, data and copies do not disturb each other."""

import copy
import pickle

import mujoco
import numpy as np
import pytest
from scenes import compiled, run
from stepping.time_stepping.promises.started import box, pile
from stepping.time_stepping.stepped import FLOOR, stepping

from impactlaw import Moreau, Newton
from impactlaw.errors import SceneError
from impactlaw.models import SCENES, load

every_scene = pytest.mark.parametrize("scene", SCENES)


def trajectory(model, stepper, data, steps):
    seen = []
    for _ in range(steps):
        stepper.step(data)
        seen.append(np.concatenate([data.qpos, data.qvel, [data.time]]))
    return np.array(seen)


@every_scene
def test_the_same_run_twice_is_the_same_bit_for_bit(scene):
    runs = []
    for _ in range(2):
        model, data = load(scene)
        runs.append(trajectory(model, stepping(model, Moreau(0.6)), data, 120))
    np.testing.assert_array_equal(*runs)


def test_a_pile_is_the_same_twice_bit_for_bit():
    runs = []
    for _ in range(2):
        model, data = compiled(pile())
        runs.append(trajectory(model, stepping(model, Moreau(0.6)), data, 120))
    np.testing.assert_array_equal(*runs)


def test_two_steppers_on_one_model_do_not_disturb_each_other():
    model, one = compiled(pile())
    two = mujoco.MjData(model)
    alone = trajectory(model, stepping(model, Moreau(0.6)), mujoco.MjData(model), 60)
    a, b = stepping(model, Moreau(0.6)), stepping(model, Moreau(0.0))
    together = []
    for _ in range(60):
        a.step(one)
        b.step(two)
        together.append(np.concatenate([one.qpos, one.qvel, [one.time]]))
    np.testing.assert_array_equal(together, alone)
    assert not np.array_equal(one.qpos, two.qpos)


def test_one_stepper_steps_several_data_in_turn():
    model, one = compiled(pile(3))
    alone = trajectory(model, stepping(model, Moreau(0.6)), mujoco.MjData(model), 60)
    two, stepper, together = mujoco.MjData(model), stepping(model, Moreau(0.6)), []
    two.qpos[0] += 0.3
    for _ in range(60):
        stepper.step(one)
        stepper.step(two)
        together.append(np.concatenate([one.qpos, one.qvel, [one.time]]))
    assert np.array(together) == pytest.approx(alone, abs=1e-6)


def test_data_of_a_reset_go_on_as_those_of_a_new_stepper():
    model, data = load("ball_stack")
    stepper = stepping(model, Moreau(0.5))
    first = trajectory(model, stepper, data, 150)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    again = trajectory(model, stepper, data, 150)
    np.testing.assert_array_equal(again, first)


def test_a_state_that_is_set_between_steps_is_taken():
    model, data = compiled(FLOOR + box("a", "0 0 .1"))
    stepper = stepping(model, Newton(0.5))
    run(stepper, data, 10)
    data.qpos[2], data.qvel[2] = 0.1 + 1e-4, -3.0
    (event,) = run(stepper, data, 1)
    assert event.impact.collision.pre_velocity[2] == -3.0
    assert data.qvel[2] == pytest.approx(1.5, abs=1e-9)


def test_data_of_another_model_are_refused():
    model, _ = load("billiard_rack")
    _, data = load("bouncing_ball")
    with pytest.raises(SceneError, match="another model"):
        stepping(model, Moreau(1)).step(data)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda pair: pickle.loads(pickle.dumps(pair))])
def test_copies_and_pickles_go_on_like_the_original(duplicate):
    model, data = load("bouncing_ball")
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 60)
    other, copied = duplicate((stepper, data))
    mine = trajectory(model, stepper, data, 80)
    theirs = trajectory(other.model, other, copied, 80)
    np.testing.assert_array_equal(mine, theirs)


def test_a_stepper_out_of_a_pickle_takes_data_of_the_original_model():
    """Its own model has lost its signature; data of other bodies are still refused."""
    model, data = load("bouncing_ball")
    stepper = stepping(model, Moreau(0.5))
    run(stepper, data, 60)
    other, copied = pickle.loads(pickle.dumps(stepper)), copy.copy(data)
    np.testing.assert_array_equal(trajectory(model, other, copied, 80), trajectory(model, stepper, data, 80))
    with pytest.raises(SceneError, match="another model"):
        other.step(load("billiard_rack")[1])


def test_copied_data_go_on_like_the_original():
    model, data = compiled(pile())
    run(stepping(model, Moreau(0.5)), data, 30)
    runs = [trajectory(model, stepping(model, Moreau(0.5)), copy.copy(data), 40) for _ in range(2)]
    np.testing.assert_array_equal(*runs)
