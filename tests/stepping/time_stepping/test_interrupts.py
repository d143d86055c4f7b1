"""Interrupts during time steps: each is raised, and the step is either finished exactly or not taken at all."""

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np
import pytest

from impactlaw import Law, Newton, Poisson, Stepper
from impactlaw.stepping.compiled.law_table import Coefficients
from impactlaw.stepping.time_stepping import scheme
from impactlaw.stepping.time_stepping.calls import Calls
from impactlaw.stepping.time_stepping.compiled.state.memory import MEMORY

SCENE = """<mujoco><option timestep=".005"/><worldbody><geom name="floor" type="plane" size="3 3 1" friction=".7"/>
  <body pos="0 0 .3"><freejoint/><geom name="box" type="box" size=".1 .08 .06" condim="4"/></body>
  <body pos=".1 0 .5"><freejoint/><geom name="ball" size=".07" condim="6" friction=".5 .01 .001"/></body>
  </worldbody></mujoco>"""


def slower(speed: float) -> float:
    return 0.5 / (1.0 + speed)


def state(data: mujoco.MjData) -> tuple[float, ...]:
    return data.time, *data.qpos, *data.qvel, *data.xipos.flat


def expect_the_same(
    law: Law, disturb: Callable[[], AbstractContextManager[object]], *, called_back: bool = False
) -> int:
    """Take steps with interrupts, after which they are taken again, and the same ones without; return how many came.

    The model must stay as it is, too. MuJoCo's callbacks may be set, which change nothing.
    """
    model = mujoco.MjModel.from_xml_string(SCENE)
    (stepper, data), (other, alike) = [
        (Stepper(model, law, scheme="time-stepping"), mujoco.MjData(model)) for _ in range(2)
    ]
    data.qvel[:] = alike.qvel[:] = np.random.default_rng(0).normal(size=12)
    stepping: Any = stepper.stepping
    kept, interrupts = (model.opt.disableflags, model.opt.cone, *model.geom_margin), 0
    if called_back:
        mujoco.set_mjcb_passive(lambda model, data: None)
        mujoco.set_mjcb_control(lambda model, data: None)
        mujoco.set_mjcb_contactfilter(lambda model, data, one, other: 0)
    for _ in range(200):
        other.step(alike)
        while data.time < alike.time:
            before, memory = state(data)[:-9], stepping.numbers[MEMORY.known : MEMORY.collided].copy()
            try:
                with disturb():
                    stepper.step(data)
            except KeyboardInterrupt:
                interrupts += 1
                if data.time < alike.time:
                    assert state(data)[:-9] == before
                    np.testing.assert_array_equal(stepping.numbers[MEMORY.known : MEMORY.collided], memory)
        assert state(data) == state(alike)
        assert (model.opt.disableflags, model.opt.cone, *model.geom_margin) == kept
    assert stepper.short_steps == other.short_steps
    return interrupts


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Have interrupts raised, which other tests may have changed, and take callbacks off at the end."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
    for name in ("passive", "control", "contactfilter"):
        getattr(mujoco, f"set_mjcb_{name}")(None)


@pytest.mark.parametrize("at_the_end", [False, True])
@pytest.mark.parametrize(("law", "called_back"), [(Newton(slower), False), (Poisson(0.5), False), (Newton(0.5), True)])
def test_interrupts_of_what_compiled_code_calls(law, called_back, at_the_end):
    """It announces each problem by a call, asks laws by another one, has collisions kept, and sets controls."""

    def interrupted(self: Calls, place: int) -> int:
        hit = rng.random() < 0.1
        if hit and not at_the_end:
            signal.raise_signal(signal.SIGINT)
        reply = own(self, place)
        if hit:
            signal.raise_signal(signal.SIGINT)
        return reply

    rng, own = np.random.default_rng(0), Calls.__call__
    assert expect_the_same(law, lambda: patch.object(Calls, "__call__", interrupted), called_back=called_back) > 15


@pytest.mark.parametrize("name", ["empty_stack", "restore_state"])
def test_a_second_interrupt_while_a_step_is_undone(name):
    """The first one arises in a callback; the second one comes before a part of the state is restored."""

    def interrupted(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if rng.random() < 0.1:
            pending.append(True)
            raise KeyboardInterrupt

    def again(*given: Any) -> None:
        if pending:
            pending.clear()
            seconds.append(True)
            signal.raise_signal(signal.SIGINT)
        undo(*given)

    @contextmanager
    def disturbed() -> Iterator[None]:
        mujoco.set_mjcb_passive(interrupted)
        try:
            with patch.object(scheme, name, again):
                yield
        finally:
            mujoco.set_mjcb_passive(lambda model, data: None)

    rng, undo, pending, seconds = np.random.default_rng(0), getattr(scheme, name), [], []
    assert expect_the_same(Newton(0.5), disturbed, called_back=True) == len(seconds) > 15


def test_interrupts_when_a_contact_has_been_added_to_the_table_of_coefficients():
    def interrupted(self: Coefficients, key: int) -> None:
        own(self, key)
        signal.raise_signal(signal.SIGINT)

    own = Coefficients.learn
    assert expect_the_same(Newton({"*": 0.5}), lambda: patch.object(Coefficients, "learn", interrupted)) > 1


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="on Windows no signal can be sent after a given time")
@pytest.mark.parametrize("called_back", [False, True])
def test_interrupts_at_any_time(called_back):
    """Most of them come while compiled code runs, and arise at the entry of what it calls in Python."""

    def stop(*given: object) -> None:
        if armed:
            armed.clear()
            sent.append(True)
            raise KeyboardInterrupt

    @contextmanager
    def disturbed() -> Iterator[None]:
        signal.setitimer(signal.ITIMER_REAL, rng.choice([0.0, rng.uniform(2e-5, 4e-4)]))  # 0 for none
        armed.append(True)
        yield
        armed.clear()
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    rng, armed, sent, before = np.random.default_rng(), [], [], signal.getsignal(signal.SIGALRM)
    signal.signal(signal.SIGALRM, stop)
    try:
        arrived = expect_the_same(Poisson(0.5), disturbed, called_back=called_back)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert arrived == len(sent) > 0


def test_errors_of_laws_keep_what_they_were_raised_from():
    def wrong(speed: float) -> float:
        raise SystemError("of the law") from KeyError("its cause")

    with pytest.raises(SystemError, match="of the law") as caught:
        expect_the_same(Newton(wrong), nullcontext)
    assert isinstance(caught.value.__cause__, KeyError)
