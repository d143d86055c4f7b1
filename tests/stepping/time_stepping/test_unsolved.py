"""Steps whose law is hard or impossible to meet, and steps with velocities that are not finite."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw import Moreau, Stepper
from impactlaw.compiled import compiled, for_python
from impactlaw.solvers.cones import CONE
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.calls import Posed
from impactlaw.stepping.time_stepping.problem import energy
from impactlaw.stepping.time_stepping.problem.rows import Known, Rows
from impactlaw.stepping.time_stepping.problem.solution.contact_problem import Aims, Method
from impactlaw.stepping.time_stepping.problem.solution.resolve import resolve
from impactlaw.stepping.time_stepping.scheme import TimeStepping
from scripts.cone_solvers import capture, solvers

_lose_energy = for_python(energy.lose_energy)


@compiled()
def _resolve_to(rows, aims, bound, known, method, inertia, x, change, shift, reached, z):
    return resolve(rows, aims, bound, known, 0.002, True, False, method, inertia, x, change, shift, reached, z)


class Resolved(NamedTuple):
    """What a problem leads to."""

    change: np.ndarray  # change of velocity, (nv,)
    shift: np.ndarray  # velocity that opens overlaps, (nv,)
    missed: float  # largest amount by which a contact velocity misses its target, m/s


def _resolve(rows: Rows, target: list[float], tree: np.ndarray) -> Resolved:
    """Resolve contacts of masses of 1 kg on rails, each a tree of bodies, with all restitution, without friction."""
    nv, g, none, no = len(tree), len(target), np.zeros(len(target), dtype=bool), np.zeros(0)
    one, count, at = np.ones(nv), np.ones(nv, np.int32), np.arange(nv, dtype=np.int32)
    known = Known(np.zeros((4, 0), np.int32), np.zeros(0, np.int64), no, no, np.zeros((2, 0)))
    change, shift = np.zeros((2, nv))
    found = _resolve_to(
        rows, Aims(np.array(target), np.zeros(g), none), none, known, Method(tree, True, 1, np.ones(1)),
        Inertia(one, one, count, at, np.zeros(nv, np.int32)), np.zeros(g), change, shift, np.zeros(g), np.zeros(nv),
    )  # fmt: skip
    return Resolved(change, shift, found[1])


def _resolved(direction: list[float], free: list[float], target: list[float]) -> tuple[np.ndarray, float]:
    """Return the velocity change of 1 kg on a rail under these contacts, and the error with respect to its law, m/s."""
    n = len(free)
    at = np.arange(n, dtype=np.int32)
    sparse = np.ascontiguousarray([np.ones(n), at, at], dtype=np.int32)
    groups = np.ascontiguousarray([at, np.ones(n), np.full(n, CONE), at], dtype=np.int32)
    rates = np.ascontiguousarray([np.ones(n), free, free, np.zeros(n), np.zeros(n)])
    rows = Rows(sparse, np.zeros(n, np.int32), np.array(direction), groups, np.arange(n), np.zeros((2, n)), rates)
    answer = _resolve(rows, target, np.zeros(1, np.int32))
    return answer.change, answer.missed


def test_a_law_that_can_be_met_is():
    change, missed = _resolved([1.0], [-2.0], [1.0])
    assert missed < 1e-9
    np.testing.assert_allclose(change, 3.0, atol=1e-9)


def test_contradictory_targets_add_no_energy():
    change, missed = _resolved([1.0, -1.0], [0.0, 0.0], [1.0, 3.0])
    assert missed > 0.5
    np.testing.assert_allclose(change, 0.0, atol=1e-12)


def test_velocities_that_are_not_finite_are_not_taken_for_zero():
    assert np.isnan(_resolved([1.0], [np.nan], [0.0])[1])


def test_an_overlap_whose_gradient_nearly_vanishes_moves_a_joint_by_little():
    gap, timestep = -0.1, 0.002
    groups = np.array([[0], [1], [CONE], [0]], np.int32)
    amounts, rates = np.array([[gap], [0.0]]), np.array([[1.0], [0.0], [0.0], [0.0], [0.0]])
    sparse, first = np.array([[1], [0], [0]], np.int32), np.zeros(1, np.int32)
    rows = Rows(sparse, first, np.array([1e-9]), groups, np.zeros(1, np.int64), amounts, rates)
    shift = _resolve(rows, [0.0], first).shift
    np.testing.assert_allclose(timestep * shift, 0.1, rtol=1e-12)  # m; without a bound it would be 2e6


def _two_pucks(impulse: np.ndarray, *, unsolved: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the impulses kept by two pucks of 1 kg that hit a floor at 1 m/s, and the velocities after them."""
    one = np.ones(4, np.int32)
    sparse = np.ascontiguousarray([one, np.arange(4), np.arange(4)], dtype=np.int32)
    groups = np.array([[0, 2], [2, 2], [CONE, CONE], [0, 1]], np.int32)
    velocity = np.array([-1.0, 0.0, -1.0, 0.0])
    rates = np.ascontiguousarray([np.ones(4), velocity, velocity, np.zeros(4), np.zeros(4)])
    x, z, after = impulse.copy(), impulse.copy(), velocity + impulse
    entries = np.arange(4, dtype=np.int32), np.ones(4)
    rows = Rows(sparse, *entries, groups, np.zeros(2, np.int64), np.zeros((2, 2)), rates)
    _lose_energy(rows, np.zeros(2), np.array([0, 0, 1, 1], np.int32), unsolved, x, z, after)
    np.testing.assert_allclose(z, x, atol=1e-15)
    np.testing.assert_allclose(after, velocity + x, atol=1e-15)
    return x, after


def test_friction_that_throws_a_body_loses_its_energy_and_others_keep_what_they_have():
    x, after = _two_pucks(np.array([1.0, 0.0, 1.0, 5.0]), unsolved=True)
    np.testing.assert_array_equal(x[:2], [1.0, 0.0])
    np.testing.assert_allclose(x[2:], np.array([1.0, 5.0]) / 13.0)
    np.testing.assert_allclose(after[2:] @ after[2:], 1.0)  # twice the energy before


def test_what_is_solved_keeps_its_impulses():
    impulse = np.array([1.0, 0.0, 1.0, 5.0])
    np.testing.assert_array_equal(_two_pucks(impulse, unsolved=False)[0], impulse)


def test_a_body_that_cannot_meet_its_law_takes_nothing_from_another():
    """Two masses on rails: walls throw the first one back from both sides, the second one rebounds."""
    at, one, free = np.arange(3, dtype=np.int32), np.ones(3), np.array([0.0, 0.0, -2.0])
    rows = Rows(
        np.ascontiguousarray([one, at, at], dtype=np.int32), np.array([0, 0, 1], np.int32), np.array([1.0, -1.0, 1.0]),
        np.ascontiguousarray([at, one, np.full(3, CONE), at], dtype=np.int32), np.arange(3), np.zeros((2, 3)),
        np.ascontiguousarray([one, free, free, np.zeros(3), np.zeros(3)]),
    )  # fmt: skip
    answer = _resolve(rows, [1.0, 3.0, 1.0], np.array([0, 1], np.int32))
    assert answer.missed > 0.5
    np.testing.assert_allclose(answer.change, [0.0, 3.0], atol=1e-9)


def test_friction_of_leaning_dominoes_is_found():
    """Contacts at both ends of an edge make friction non-unique, and some contacts barely touch."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], friction=[0.5, 0, 0])
    for i in range(12):
        body = spec.worldbody.add_body(pos=[0.022 * i, 0, 0.024])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.004, 0.012, 0.024], friction=[0.5, 0, 0])
    model = spec.compile()
    posed, unsolved = 0, 0

    def look(given: Posed) -> None:
        nonlocal posed, unsolved
        posed += 1
        if posed % 3 == 0:
            problem = capture.problem_of("", given, model.dof_treeid, exact=True)
            unsolved += problem.natural_map(solvers.compiled(problem, problem.guess)()[0]) > 1e-8

    for start in ((0.096, 0.016, 4.0), (0.1, 0.0, 3.5), (0.12, 0.02, 4.5)):  # one alone is a matter of chance
        data = mujoco.MjData(model)
        data.qvel[[0, 2, 4]] = start
        stepper = Stepper(model, Moreau(0.5), scheme="time-stepping")
        assert isinstance(stepper.stepping, TimeStepping)
        stepper.stepping.watch(look)
        for _ in range(450):
            stepper.step(data)
    assert posed > 4500
    assert unsolved < 0.01 * posed / 3
