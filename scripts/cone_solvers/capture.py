"""Capture contact problems with friction as time stepping poses them.

A scene is stepped from drops and with random controls, with e = 0 and 0.5, under several seeds. Every few steps the
first problem of a step is copied. Problems that zero impulses solve are left out.
"""

from typing import Any

import mujoco
import numpy as np
from scipy import sparse

from impactlaw import ImpactLawError, Moreau, Stepper
from impactlaw.compiled import compiled
from impactlaw.solvers.cones import CONE
from impactlaw.stepping.time_stepping.calls import Posed
from impactlaw.stepping.time_stepping.problem.targets import write_offsets
from impactlaw.stepping.time_stepping.scheme import TimeStepping
from scripts.robots import starts
from scripts.robots.scenes import Loaded, Scene

from .catalogue import load_with_friction
from .problem import Problem, scaled

_RUNS = 24  # largest number of runs per scene
_SHARES = 6  # smallest number of runs that the problems of a scene are taken from
_MANY = 100  # number of degrees of freedom from which runs are short and start slowly
_STEPS, _FEW_STEPS = 600, 80
_SPEED, _SLOW = 1.0, 0.1  # standard deviation of velocities at the start, m/s or rad/s
_FASTEST = 300.0  # m/s or rad/s; a faster motion has diverged and is not typical of robots
_BETWEEN, _FEW_BETWEEN = (3, 15), (1, 5)  # steps from one problem to the next
_TRIVIAL = 1e-8  # natural map of zero impulses up to which a problem is trivial
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


def problems_of(scene: Scene, count: int) -> list[Problem]:
    """Return up to `count` problems of a scene, the same ones in every call."""
    loaded = load_with_friction(scene)
    share, taken = -(-count // _SHARES), []
    for run in range(_RUNS):
        if len(taken) == count:
            break
        wanted = min(share, count - len(taken))
        taken += problems_of_run(scene, loaded, wanted, np.random.default_rng([0, run]), run)
    return taken


def problems_of_run(scene: Scene, loaded: Loaded, count: int, rng: np.random.Generator, run: int) -> list[Problem]:
    """Return the problems of one run; its number determines restitution and controls."""
    model = loaded.model
    data = _start(scene, loaded, rng)
    options: dict[str, Any] = {"scheme": "time-stepping", "overlap": "push-out"}
    stepper = Stepper(model, Moreau((0.0, 0.5)[run % 2]), **options)
    steps, between = (_STEPS, _BETWEEN) if model.nv < _MANY else (_FEW_STEPS, _FEW_BETWEEN)
    kind = "drop" if run // 2 % 2 or not model.nu else "random"
    controls = starts.controls(model, kind, data.ctrl.copy(), -(-steps // starts.HELD), int(rng.integers(1 << 31)))
    taken, seen = list[Problem](), list[Problem]()
    due = int(rng.integers(*between))
    assert isinstance(stepper.stepping, TimeStepping)
    exact = stepper.stepping.law.exact
    stepper.stepping.watch(lambda posed: seen.append(problem_of(scene.name, posed, model.dof_treeid, exact=exact)))
    for step in range(steps):
        data.ctrl[:] = controls[step // starts.HELD]
        seen.clear()
        try:
            stepper.step(data)
        except (ImpactLawError, mujoco.FatalError):  # the motion diverges, or there are more contacts than memory
            break
        if not np.abs(data.qvel).max() < _FASTEST or not np.isfinite(stepper.shortfall):
            break
        if step >= due and seen and _is_worth_solving(problem := scaled(seen[0])):
            taken.append(problem)
            due = step + int(rng.integers(*between))
        if len(taken) == count:
            break
    return taken


def _start(scene: Scene, loaded: Loaded, rng: np.random.Generator) -> mujoco.MjData:
    """Return the scene's start, raised by a random height and with random velocities."""
    model = loaded.model
    data = starts.start(loaded, 2.0 * scene.raised * rng.uniform())
    moved = np.ones(model.nv, bool)
    if model.nv < _MANY and (model.jnt_type == _FREE).any():  # only the free bodies move
        moved = model.jnt_type[model.dof_jntid] == _FREE
    data.qvel[moved] += (_SPEED if model.nv < _MANY else _SLOW) * rng.normal(size=np.count_nonzero(moved))
    return data


def problem_of(scene: str, posed: Posed, tree: np.ndarray, *, exact: bool) -> Problem:
    """Return a problem that a step has posed, not scaled; ``tree``, (nv,), is that of each degree of freedom."""
    given, groups, rates = posed.rows, posed.rows.groups, posed.rows.rates
    indptr = np.concatenate([[0], np.cumsum(given.sparse[0])]).astype(np.int32)
    assert (given.sparse[1] == indptr[:-1]).all()
    return Problem(
        scene=scene,
        rows=sparse.csr_array((given.value, given.colind, indptr), shape=(groups[1].sum(), len(tree))),
        tree=tree.copy(),
        size=groups[1].copy(),
        kind=groups[2].copy(),
        bound=given.amounts[1].copy(),
        compliance=rates[4].copy(),
        offset=_offsets(groups, rates, posed.target, posed.sliding),
        guess=posed.guess,
        exact=exact,
        rounds=posed.rounds,
    )


@compiled()
def _offsets(groups, rates, target, sliding):
    """Return the offsets that `write_offsets` writes, (n,)."""
    b = np.empty(rates.shape[1])
    write_offsets(groups, rates, target, sliding, b)
    return b


def _is_worth_solving(problem: Problem) -> bool:
    """Return whether the problem has friction, and zero impulses do not solve it."""
    rubs = (problem.kind == CONE) & (problem.size > 1)
    return bool(rubs.any() and problem.scale > 0.0 and problem.natural_map(0.0 * problem.offset) > _TRIVIAL)
