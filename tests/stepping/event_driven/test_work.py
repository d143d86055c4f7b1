"""The work of a step is counted where it is done: detection, searches for restitution, and hard problems."""

import itertools

import mujoco
import numpy as np
import pytest

from impactlaw import Collision, Coulomb, Friction, MaximalDissipation, Newton, Stepper
from impactlaw.errors import UnfinishedStepError
from impactlaw.solvers.friction.problem import ConeProblem
from impactlaw.solvers.friction.solve import BRIEF, STEPS_OF_A_ROUND, solve_cones
from impactlaw.solvers.problem import Status
from impactlaw.stepping.work import Work

ROD = Collision(  # oblique: it would gain energy with all of its restitution
    [[1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 1, -0.6]], [1, -1, 0], friction=Friction([[1, 0, 0.8]], [0], [0.7])
)


class Counted:
    """Counts attempts, and ends the step after a given number of them."""

    hasty = False

    def __init__(self, most: float = np.inf):
        self.count, self.most = 0, most

    def rounds(self, rows: int) -> int:
        return BRIEF

    def steps(self, rows: int) -> float:
        return np.inf

    def attempt(self, rows: int, steps: int) -> None:
        self.count += 1
        if self.count > self.most:
            raise UnfinishedStepError("enough")

    def begin_part(self) -> None:
        """Keep the count, because all parts share the budget."""


def test_every_attempt_of_a_search_for_restitution_is_counted():
    law, effort = Coulomb(Newton(1.0)), Counted()
    impact = law.resolve(ROD, effort=effort)
    assert impact.restitution_scale == pytest.approx(law.resolve(ROD).restitution_scale, rel=1e-9)
    assert effort.count == 3  # full restitution, none, and the share that the energies of both determine
    with pytest.raises(UnfinishedStepError):
        law.resolve(ROD, effort=Counted(2))


def test_a_step_gives_up_a_collision_that_takes_too_much():
    work = Work(3, 1.0)
    work.begin()
    with pytest.raises(UnfinishedStepError, match="more work than it may"):
        Coulomb(Newton(1.0)).resolve(ROD, effort=work)


def test_a_problem_without_a_solution_ends_soon():
    """Two contacts with torsion and rolling that must separate from each other in opposite directions."""
    A = np.random.default_rng(0).normal(size=(12, 8))
    A[6] = -A[0]
    b = np.zeros(12)
    b[[0, 6]] = -1.0
    answer = solve_cones(ConeProblem(A, b, np.array([6, 6])), rounds=BRIEF)
    assert answer.status is Status.STOPPED
    assert answer.iterations <= 100 + 1.5 * BRIEF * STEPS_OF_A_ROUND


def looks(work: Work) -> int:
    work.begin()
    for count in itertools.count():
        try:
            work.look(4)
        except UnfinishedStepError:
            return count
    raise AssertionError


def test_looks_cost_more_with_more_freedoms_and_with_meshes():
    assert looks(Work(30, 100.0)) < 0.6 * looks(Work(3, 100.0))
    assert looks(Work(18, 100.0, convex=True)) < 0.6 * looks(Work(18, 100.0))


def test_hard_problems_get_fewer_rounds_where_little_work_is_left():
    work = Work(100, 100.0)
    work.begin()
    assert work.rounds(12) == BRIEF
    assert work.rounds(300) < BRIEF
    work.begin(0.01)
    assert work.rounds(300) == 1


LOCKED = """<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody>
  <body><joint name="base" type="slide" damping="1e9"/><geom size=".1" mass="1" contype="0" conaffinity="0"/>
    <body><joint name="finger" type="slide" range="0 .1" limited="true"/>
      <geom size=".1" mass=".1" contype="0" conaffinity="0"/></body></body></worldbody>
  <actuator><motor joint="finger"/></actuator></mujoco>"""


def test_what_damping_locks_is_not_moved_by_contact_that_is_held():
    """With the mass matrix alone, the finger's limit would move the base at 0.018 m/s."""
    model = mujoco.MjModel.from_xml_string(LOCKED)
    data, stepper = mujoco.MjData(model), Stepper(model, MaximalDissipation())
    data.ctrl[0] = -10.0
    for _ in range(20):
        stepper.step(data)
        assert abs(data.qvel[0]) < 1e-6
        assert data.qpos[1] == pytest.approx(0.0, abs=1e-8)
    assert stepper.unlocated == 20
    with pytest.raises(UnfinishedStepError, match="damping all but locks"):
        Stepper(model, MaximalDissipation(), on_unsolved="raise").step(data)
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    stepper.step(data)
    assert stepper.unlocated == 21
