"""Laws with their own rule for friction, such as Poisson's: what they ask of contacts takes limited work."""

import mujoco
import numpy as np
import pytest

from impactlaw import Poisson, Stepper
from impactlaw.solvers.friction import solve
from impactlaw.stepping.time_stepping import calls
from impactlaw.stepping.time_stepping.tolerances import LAW_WORK

BOX = '<body pos="{} {} {}"><freejoint/><geom type="box" size=".05 .05 .05" friction=".8"/></body>'
GAP = 0.1005


def boxes(n: int) -> mujoco.MjModel:
    """Return a block of n x n x n boxes that nearly touch."""
    places = ([GAP * i for i in place] for place in np.ndindex(n, n, n))
    bodies = "".join(BOX.format(x, y, 0.06 + z) for x, y, z in places)
    floor = '<geom type="plane" size="3 3 1"/>'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep=".005"/><worldbody>{floor}{bodies}</worldbody></mujoco>'
    )


def stepper_and_data(n: int) -> tuple[Stepper, mujoco.MjData]:
    model = boxes(n)
    data = mujoco.MjData(model)
    data.qvel[:] = 0.5 * np.random.default_rng(0).normal(size=model.nv)
    return Stepper(model, Poisson(0.9), scheme="time-stepping"), data


def test_a_block_of_boxes_takes_no_longer_than_it_may(monkeypatch: pytest.MonkeyPatch):
    """Without a limit, the search for impulses of its expansion takes a minute; with one, the loss is counted."""
    found, work = solve.compiled_answer, [0.0]

    def counted(problem, *given, **options):
        x, taken = found(problem, *given, **options)
        work[0] += taken * solve.cost(problem.start.size, problem.rows.shape[1])[1]
        if work[0] > 20.0 * LAW_WORK:
            pytest.fail(f"{work[0]:.0f} units of work in a step, of {LAW_WORK:.0f}")
        return x, taken

    monkeypatch.setattr(solve, "compiled_answer", counted)
    stepper, data = stepper_and_data(4)
    stepper.step(data)
    assert work[0] <= 2.0 * LAW_WORK  # an attempt that has begun may exceed it
    assert stepper.short_steps == 1


@pytest.mark.parametrize("most", [LAW_WORK, 0.0])
def test_steps_in_which_the_law_finds_no_impulses_are_short(monkeypatch: pytest.MonkeyPatch, most):
    """Then contacts have the restitution of the law without friction: the corner of a box bounces all the same."""
    monkeypatch.setattr(calls, "LAW_WORK", most)
    stepper, data = stepper_and_data(1)
    data.qpos[2], data.qpos[3:7], data.qvel[:] = 0.09, [0.8, 0.5, 0.2, 0.0], [0.2, 0.1, -1, 0, 0, 0]
    while not stepper.events:
        stepper.step(data)
    impact = stepper.events[0].impact
    assert stepper.short_steps == (most == 0.0)
    ratio = impact.post_contact_velocity / -impact.collision.pre_contact_velocity
    assert (np.abs(ratio - 0.9) < 1e-3) == (most == 0.0)  # with friction it is the ratio of impulses that is .9
