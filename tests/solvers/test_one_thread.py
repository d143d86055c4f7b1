"""Dense problems are solved on one BLAS thread, without an effect on other code."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from threading import Barrier

import mujoco
import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from impactlaw import Collision, Moreau, Stepper
from impactlaw.solvers import SOLVERS
from impactlaw.solvers.one_thread import one_thread


def threads() -> list[int]:
    return [library["num_threads"] for library in ThreadpoolController().select(user_api="blas").info()]


@pytest.fixture
def several():
    """Allow two BLAS threads, as a user's process may, whatever the machine."""
    import_module("scipy.linalg")  # which loads a BLAS library of its own
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        if min(threads()) < 2:
            pytest.skip("this BLAS has one thread only")
        yield


@pytest.mark.usefixtures("several")
def test_a_large_collision_is_solved_on_one_thread(monkeypatch):
    seen, solve = [], SOLVERS["nnls"]

    def watched(problem):
        seen.append(threads())
        return solve(problem)

    monkeypatch.setitem(SOLVERS, "nnls", watched)
    gradients = np.random.default_rng(0).normal(size=(128, 134))
    Moreau(0.5).resolve(Collision(np.eye(134), gradients, np.ones(134)), solver="nnls")
    assert {count for counts in seen for count in counts} == {1}
    assert min(threads()) == 2


@pytest.mark.usefixtures("several")
def test_an_event_driven_step_takes_one_thread_and_gives_the_others_back(monkeypatch):
    seen = []
    boxes = "".join(f'<body pos="{x} 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>' for x in range(4))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="plane" size="9 9 1"/>{boxes}</worldbody></mujoco>'
    )  # 24 degrees of freedom: linear algebra of fewer than 20 starts no threads
    data, stepper = mujoco.MjData(model), Stepper(model, Moreau(0.5))
    data.qvel[:2] = 1.0
    mujoco.set_mjcb_control(lambda model, data: seen.append(threads()))
    try:
        stepper.step(data)
    finally:
        mujoco.set_mjcb_control(None)
    assert {count for counts in seen for count in counts} == {1}
    assert min(threads()) == 2


@pytest.mark.usefixtures("several")
def test_threads_that_step_at_the_same_time_put_back_what_was():
    inside = Barrier(2, timeout=10)

    def step(_):
        with one_thread():
            inside.wait()
            with one_thread():
                pass

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(step, range(20)))
    assert threads() == [2] * len(threads())
