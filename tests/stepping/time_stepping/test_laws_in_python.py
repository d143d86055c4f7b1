"""Laws that compiled steps ask in Python at each collision."""

import gc
import threading
import weakref

import mujoco
import numpy as np
import pytest

from impactlaw import Law, Newton, Poisson, Stepper

SCENE = """<mujoco><option timestep=".005"/><worldbody><geom name="floor" type="plane" size="3 3 1" friction=".7"/>
  <body pos="0 0 .3"><freejoint/><geom name="box" type="box" size=".1 .08 .06" condim="4"/></body>
  <body pos=".1 0 .5"><freejoint/><geom name="ball" size=".07" condim="6" friction=".5 .01 .001"/></body>
  </worldbody></mujoco>"""


def thrown(law: Law) -> tuple[Stepper, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(0).normal(size=12)
    return Stepper(model, law, scheme="time-stepping"), data


def slower(speed: float) -> float:
    return 0.5 / (1.0 + speed)


@pytest.mark.parametrize("which", [1, 4, 9])
def test_a_step_whose_law_raises_has_not_been_taken(which: int):
    """Neither data nor what the stepper remembers of the last step has changed: motion goes on bit for bit."""

    def fails_once(speed: float) -> float:
        asked[0] += 1
        if asked[0] == which:
            raise ValueError("not now")
        return slower(speed)

    asked, failed = [0], 0
    (stepper, one), (other, alike) = thrown(Newton(fails_once)), thrown(Newton(slower))
    for _ in range(300):
        before = one.time, *one.qpos, *one.qvel
        memory = stepper.stepping.numbers.copy()  # pyright: ignore[reportAttributeAccessIssue]
        try:
            stepper.step(one)
        except ValueError:
            failed += 1
            assert (one.time, *one.qpos, *one.qvel) == before
            np.testing.assert_array_equal(stepper.stepping.numbers, memory)  # pyright: ignore[reportAttributeAccessIssue]
            stepper.step(one)
        other.step(alike)
    assert failed == 1
    np.testing.assert_array_equal(one.qpos, alike.qpos)
    assert stepper.short_steps == other.short_steps


def test_threads_ask_their_laws_side_by_side():
    def run() -> None:
        stepper, data = thrown(Poisson(0.5))
        events = 0
        for _ in range(200):
            stepper.step(data)
            events += len(stepper.events)
        found.append((*data.qpos, events))

    found: list[tuple[float, ...]] = []
    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    run()
    assert len(found) == 5
    assert len(set(found)) == 1


def test_a_control_callback_is_called_once_a_step():
    """Neither contacts that the law's table lacks yet nor the reading of events call it again."""

    def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        calls.append(data.time)

    calls: list[float] = []
    stepper, data = thrown(Newton({"*": 0.5}))
    collided = 0
    mujoco.set_mjcb_control(control)
    try:
        for _ in range(200):
            stepper.step(data)
            collided += len(stepper.events)
    finally:
        mujoco.set_mjcb_control(None)
    assert collided > 3
    assert len(calls) == len(set(calls)) == 200


def test_watching_problems_changes_no_step_and_errors_of_the_watcher_are_raised():
    def wrong(problem: object) -> None:
        raise LookupError("from the watcher")

    seen: list[object] = []
    (stepper, one), (other, alike) = thrown(Newton({"*": 0.5})), thrown(Newton({"*": 0.5}))
    stepper.stepping.watch(seen.append)  # pyright: ignore[reportAttributeAccessIssue]
    for _ in range(300):
        stepper.step(one)
        other.step(alike)
    np.testing.assert_array_equal(one.qpos, alike.qpos)
    assert len(seen) > 30
    stepper.stepping.watch(wrong)  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(LookupError, match="from the watcher"):
        stepper.step(one)
    np.testing.assert_array_equal(one.qpos, alike.qpos)


def test_steppers_are_deleted_with_their_last_reference():
    """What compiled code calls does not keep them alive, nor their data."""
    stepper, data = thrown(Poisson(0.5))
    stepper.step(data)
    gc.disable()
    try:
        gone = weakref.ref(stepper.stepping)
        del stepper
        assert gone() is None
    finally:
        gc.enable()
