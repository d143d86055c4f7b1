"""Sustained contact with friction: impulses in the friction cones that keep contacts closed and resist sliding.

After a flow of duration tau to the velocity ``v``, less what it has felt of contact (`felt_force`), the contacts that
stay closed take impulses with

    u_n = J_n (v + M^-1 J^T Lambda) + w_n,   u_t = J_t (v + M^-1 J^T Lambda) + w_t
    0 <= Lambda_n  ⊥  u_n >= 0,   Coulomb's law between Lambda_t and u_t

(Moreau's time stepping with E = 0). Forces that are constant over the flow would move the bodies as well: by
``tau M^-1 J^T Lambda`` with the semi-implicit integrators, by half of that with RK4. So a contact that sticks does not
creep: what gravity has moved, friction moves back. What is left of gaps is corrected as without friction.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np

from impactlaw.errors import SolverError
from impactlaw.scene.contacts import update_positions
from impactlaw.solvers.friction.problem import ConeProblem, ConeStatus
from impactlaw.solvers.friction.solve import solve_cones
from impactlaw.stepping.event_driven.contact_set import ContactSet, jump, kinetic_norm
from impactlaw.stepping.event_driven.contact_state import (
    CORRECTED,
    ConeRows,
    ContactForces,
    ContactState,
    Phase,
    PhaseEnd,
    stays,
)
from impactlaw.stepping.event_driven.persistent_contact.felt_force import FeltForce, constrained_velocity, moving_part
from impactlaw.stepping.work import Work

_SETTLINGS = 4  # shifts of position at most
_LARGEST_TURN = 0.3  # rad in one flow
_RANK = 1e-9  # relative singular value below which contacts press redundantly
_KINDS = 6  # rows that a contact can have: one of pressing, two of sliding, one of torsion, two of rolling


def hold_with_friction(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    phase: Phase,
    look_again: Callable[[float], tuple[ContactState, np.ndarray]],
    correct: Callable[[PhaseEnd], PhaseEnd],
) -> tuple[PhaseEnd, Callable[[], PhaseEnd]]:
    """Bring the position back to the sustained contacts; data and its frames change.

    Args:
        model: the scene.
        data: at the end of the flow, frames current.
        phase_end: the contacts there.
        phase: what led there.
        look_again: detects the contacts of now up to a gap at least, m, and matches them with the start.
        correct: opens sustained contacts that overlap.

    Returns:
        The contacts after the correction, and what brings back the velocity, too, and returns them with that. Before it
        they have the velocity of the impulses that act where the flow has led: enough for a flow that is only tried.

    Raises:
        SolverError: no solver has found the impulses.
    """
    phase_end.now.contact_set.whitened(model, data)
    felt = FeltForce.of(model, data, phase.start.force, phase.duration)
    free = constrained_velocity(model, data, phase_end.now, phase) - felt.velocity
    impulse, cone_rows, contact_forces = _press(model, data, phase_end, phase, free, None)
    change = jump(model, data, cone_rows.along, impulse)
    shift = (moving_part(model) * phase.duration) * change - felt.shift
    if np.count_nonzero(shift):
        reach = phase_end.now.contact_set.opening(shift + felt.shift)
        phase_end, contact_forces = _settle(model, data, phase_end, shift, contact_forces, phase, look_again, reach)
    phase_end = _with_more(phase_end, phase)
    if np.count_nonzero(phase_end.sustained & (phase_end.now.gap < -CORRECTED * phase.tolerance)):
        before, phase_end = phase_end.known, _with_more(correct(phase_end), phase)
        contact_forces = _matched(contact_forces, before, phase_end.known)
    now, known, sustained = phase_end
    data.qvel[:] = free + change
    tried = PhaseEnd(now._replace(contact_velocity=now.contact_set.contact_velocity(data.qvel)), known, sustained)
    return tried, partial(_hold_velocity, model, data, phase_end, phase, felt, free, contact_forces)


def _hold_velocity(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    phase: Phase,
    felt: FeltForce,
    free: np.ndarray,
    guess: np.ndarray,
) -> PhaseEnd:
    """Give the sustained contacts the velocity that they have after impulses; return them with these impulses."""
    impulse, cone_rows, contact_forces = _press(model, data, phase_end, phase, free, guess)
    turned = _turned(model, data, phase_end, phase, cone_rows)
    if turned is not None:
        free = free + jump(model, data, turned, 0.5 * impulse)
        impulse, cone_rows, contact_forces = _press(model, data, phase_end, phase, free, contact_forces)
    change, total = jump(model, data, cone_rows.along, impulse), impulse.dot(cone_rows.along)
    data.qvel[:] = free + change
    now, known, sustained = phase_end
    force = total / phase.duration if felt.is_settled(total, change) else None
    contact_state = now.moving(
        model, data, contact_forces[:, 0] > 0, ContactForces(cone_rows, contact_forces / phase.duration), force
    )
    return PhaseEnd(contact_state, known, sustained)


def _with_more(phase_end: PhaseEnd, phase: Phase) -> PhaseEnd:
    """Return the contacts with those sustained, too, that the others press closed now that they are held."""
    now, known, sustained = phase_end
    return PhaseEnd(now, known, sustained | stays(now.gap, known, phase))


def _settle(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    shift: np.ndarray,
    contact_forces: np.ndarray,
    phase: Phase,
    look_again: Callable[[float], tuple[ContactState, np.ndarray]],
    reach: float,
) -> tuple[PhaseEnd, np.ndarray]:
    """Shift the bodies, and then so that contacts that press are closed; return the contacts and their impulses.

    They are looked for up to a gap of ``reach`` at least, m: surfaces may recede, too.
    """
    held = phase_end.known[phase_end.sustained]
    for _ in range(_SETTLINGS):
        qpos = data.qpos.copy()
        mujoco.mj_integratePos(model, qpos, shift, 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        before, (now, known) = phase_end.known, look_again(max(reach, phase_end.now.contact_set.opening(shift)))
        phase_end = PhaseEnd(now, known, (known[:, None] == held[held >= 0]).any(axis=1))
        contact_forces = _matched(contact_forces, before, known)
        press = np.flatnonzero(contact_forces[:, 0] > 0)
        if np.abs(now.gap[press]).max(initial=0.0) <= CORRECTED * phase.tolerance:
            break
        along, Y, _ = now.contact_set.whitened(model, data)
        shift = jump(model, data, along[press], _opening(Y[press], -now.gap[press]))
    return phase_end, contact_forces


def _opening(gradients: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the least p with ``Y Y^T p = c``, (h,), in the sense of least squares."""
    if len(wanted) == 1 and (square := gradients[0].dot(gradients[0])) > 0:
        return wanted / square
    z = np.linalg.lstsq(gradients, wanted, rcond=_RANK)[0]
    return np.linalg.lstsq(gradients.T, z, rcond=_RANK)[0]


def _matched(contact_forces: np.ndarray, before: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return impulses, (h, 6), in the order of other contacts; both orders are told by indices at the flow's start."""
    if np.array_equal(before, known):
        return contact_forces
    result = np.zeros((len(known), _KINDS))
    for i, index in enumerate(known):
        same = np.flatnonzero(before == index)
        if index >= 0 and len(same):
            result[i] = contact_forces[same[0]]
    return result


def _press(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    phase_end: PhaseEnd,
    phase: Phase,
    free: np.ndarray,
    guess: np.ndarray | None,
) -> tuple[np.ndarray, ConeRows, np.ndarray]:
    """Return the impulses of the sustained contacts, their rows, and the impulses contact by contact, (h, 6)."""
    now, before = phase_end.now, phase.start.contact_forces
    held = now.closed
    if phase.start.force is not None and before is not None:  # it may have pushed away what it has to pull back
        held = held | ((phase_end.known >= 0) & (before.force[phase_end.known, 0] > 0))
    cone_rows = cone_rows_of(model, data, now.contact_set, phase_end.sustained & held, free)
    known = None
    if guess is not None and len(guess) == len(now.gap):
        known = guess[cone_rows.contact, cone_rows.kind]
    elif before is not None:
        index = phase_end.known[cone_rows.contact]
        known = np.where(index >= 0, before.force[index, cone_rows.kind] * phase.duration, 0.0)
    impulse = solve_cone_rows(cone_rows, known, kinetic_norm(model, data, free), phase.work, exact=phase.exact)
    contact_forces = np.zeros((len(now.gap), _KINDS))
    contact_forces[cone_rows.contact, cone_rows.kind] = impulse
    return impulse, cone_rows, contact_forces


def _turned(
    model: mujoco.MjModel, data: mujoco.MjData, phase_end: PhaseEnd, phase: Phase, cone_rows: ConeRows
) -> np.ndarray | None:
    """Return the rows at the start of the flow less those of now, (n, nv); None if they are the same.

    Half of an impulse acts along the rows of the start (as in RATTLE), so that what turns about a contact that sticks
    keeps its energy to second order.
    """
    if phase.start.contact_forces is None or not len(phase.start.contact_forces.cone_rows.contact):
        return None
    before = phase.start.contact_forces.cone_rows
    place = np.full((len(phase.start.gap), _KINDS), -1)
    place[before.contact, before.kind] = np.arange(len(before.contact))
    known = phase_end.known[cone_rows.contact]
    row = np.where(known >= 0, place[known, cone_rows.kind], -1)
    difference = np.where(row[:, None] >= 0, before.along[row] - cone_rows.along, 0.0)
    if not np.count_nonzero(difference):
        return None
    difference, whitened = phase_end.now.contact_set.confine(model, data, difference)
    change, length = np.vecdot(whitened, whitened), np.vecdot(cone_rows.whitened, cone_rows.whitened)
    difference[change > _LARGEST_TURN**2 * length] = 0.0  # another feature of the surface
    return difference if np.any(change > 1e-24 * length) else None


def cone_rows_of(
    model: mujoco.MjModel, data: mujoco.MjData, contact_set: ContactSet, held: np.ndarray, velocity: np.ndarray
) -> ConeRows:
    """Return the rows of some contacts, bool (h,), at a velocity, (nv,)."""
    contact, kind, jacobian, drift, along, whitened = contact_set.rows(model, data)
    rows = np.flatnonzero(held[contact])
    sizes = np.bincount(contact[rows], minlength=1)
    gamma = jacobian.dot(velocity) + drift
    return ConeRows(contact[rows], kind[rows], sizes[sizes > 0], along[rows], whitened[rows], gamma[rows])


def solve_cone_rows(
    cone_rows: ConeRows, guess: np.ndarray | None, speed: float, work: Work, *, exact: bool
) -> np.ndarray:
    """Return the impulses with E = 0, (n,), those of friction divided by their coefficients.

    Raises:
        SolverError: no solver has found them.
        UnfinishedStepError: that takes too much work.
    """
    rows = len(cone_rows.contact)
    work.solve(rows, 0)
    problem = ConeProblem(cone_rows.whitened, cone_rows.velocity, cone_rows.sizes, exact=exact, speed=speed)
    answer = solve_cones(problem, guess, rounds=work.rounds(rows))
    work.solve(rows, answer.iterations)
    if answer.status is not ConeStatus.SOLVED:
        raise SolverError(
            f"no impulses of {len(cone_rows.sizes)} contacts with friction were found: relative residual "
            f'{answer.residual / problem.scale:.1e}; use a smaller timestep, or friction="convex"'
        )
    return answer.impulse
