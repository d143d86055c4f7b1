"""Callbacks of the user, such as MuJoCo's filter of contacts, during time steps."""

import threading
import time
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.stepping.compiled.libmujoco import without_callbacks
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY

BOXES = """<mujoco><option timestep="0.03"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .12"><freejoint/><geom type="box" size=".1 .05 .02"/></body>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .05 .02"/></body></worldbody></mujoco>"""


def test_errors_of_a_filter_are_raised_also_where_compiled_code_calls_it():
    """Overlaps at the end of steps are opened in compiled code, which looks for contacts and calls the filter."""

    def filter_of_contacts(model: mujoco.MjModel, given: mujoco.MjData, *geoms: int) -> int:
        if given is not data:  # at the end of a step, which must not change the contacts in data
            raise ValueError("from the filter")
        return 0

    def steps() -> None:
        rng = np.random.default_rng(0)
        for _ in range(60):
            mujoco.mj_resetData(model, data)
            data.qvel[:] = rng.normal(size=12) * np.array([1, 1, 3, 20, 20, 20] * 2)
            for _ in range(15):
                stepper.step(data)

    model = mujoco.MjModel.from_xml_string(BOXES)
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    mujoco.set_mjcb_contactfilter(filter_of_contacts)
    try:
        with pytest.raises(ValueError, match="from the filter"):
            steps()
        assert mujoco.get_mjcb_contactfilter() is filter_of_contacts
    finally:
        mujoco.set_mjcb_contactfilter(None)


USED = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .101"><joint name="up" type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody>
  <actuator><general joint="up" dyntype="user" gaintype="user" biastype="user" actdim="1"/></actuator>
  <sensor><user name="own" dim="1" datatype="real" needstage="acc"/></sensor></mujoco>"""


@pytest.mark.parametrize("name", ["control", "passive", "act_dyn", "act_gain", "act_bias", "sensor"])
def test_errors_of_callbacks_are_raised_and_lose_nothing(name):
    """Compiled code calls all of them but the control; without care their errors would end the process."""

    def callback(*given: object) -> float:
        calls.append(given)
        if len(calls) == 3:
            raise ValueError("from the callback")
        return 0.0

    calls, take = [], getattr(mujoco, f"set_mjcb_{name}")
    model = mujoco.MjModel.from_xml_string(USED)
    data, alone = mujoco.MjData(model), mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
    take(callback)
    try:
        with pytest.raises(ValueError, match="from the callback"):
            for _ in range(3):
                before = data.time, data.qpos[0], data.qvel[0]
                memory = stepper.stepping.numbers[MEMORY.known :].copy()  # pyright: ignore[reportAttributeAccessIssue]
                stepper.step(data)
        assert (data.time, data.qpos[0], data.qvel[0]) == before
        np.testing.assert_array_equal(stepper.stepping.numbers[MEMORY.known :], memory)  # pyright: ignore[reportAttributeAccessIssue]
        assert getattr(mujoco, f"get_mjcb_{name}")() is callback
        for _ in range(10):
            stepper.step(data)
    finally:
        take(None)
    fresh = Stepper(model, Moreau(0.5), scheme="time-stepping")
    while alone.time < data.time - 1e-9:
        fresh.step(alone)
    assert abs(alone.qpos[0] - data.qpos[0]) < 1e-12
    assert all(given[0] is model for given in calls)


def keep_callback_through(threads: list[threading.Thread], callback: Callable[..., None]) -> None:
    """Run threads to their ends under a callback, which must then still be set."""
    mujoco.set_mjcb_passive(callback)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert mujoco.get_mjcb_passive() is callback
    finally:
        mujoco.set_mjcb_passive(None)


def test_callbacks_survive_two_threads_that_take_them_off_at_once():
    """Steppers take callbacks off while they make scenes of their own."""

    def first() -> None:
        without_callbacks(lambda: (entered.set(), time.sleep(0.05)))

    def second() -> None:
        entered.wait()
        without_callbacks(lambda: time.sleep(0.1))

    def callback(*given: object) -> None:
        pass

    entered, threads = threading.Event(), [threading.Thread(target=first), threading.Thread(target=second)]
    keep_callback_through(threads, callback)


def test_an_error_of_a_callback_reaches_only_the_thread_whose_step_has_called_it():
    models = [mujoco.MjModel.from_xml_string(USED) for _ in range(3)]
    errors: list[list[str]] = [[], [], []]

    def callback(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if model is models[1] and data.time > 0.05:
            raise ValueError("from the callback")

    def run(number: int) -> None:
        data = mujoco.MjData(models[number])
        for _ in range(200):
            try:
                steppers[number].step(data) if number < 2 else mujoco.mj_step(models[number], data)
            except ValueError as error:
                errors[number].append(str(error))
                data = mujoco.MjData(models[number])

    steppers = [Stepper(model, Moreau(0.5), scheme="time-stepping") for model in models]
    for stepper, model in zip(steppers, models, strict=True):
        stepper.step(mujoco.MjData(model))  # the first step makes a pool, during which no callback is set
    threads = [threading.Thread(target=run, args=(number,)) for number in range(3)]
    keep_callback_through(threads, callback)
    assert errors == [[], ["from the callback"] * 7, []]
