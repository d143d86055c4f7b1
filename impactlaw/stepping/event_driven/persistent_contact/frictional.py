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
from impactlaw.solvers.friction.problem import ConeProblem
from impactlaw.solvers.friction.solve import solve_cones
from impactlaw.solvers.problem import Status
from impactlaw.stepping.event_driven.contact_set import Touch, jump, kinetic_norm
from impactlaw.stepping.event_driven.contact_state import CORRECTED, Arrival, Carried, Flow, Grasp, Moment, stays
from impactlaw.stepping.event_driven.persistent_contact.felt_force import Felt, constrained_velocity, moving_part
from impactlaw.stepping.work import Work

_SETTLINGS = 4  # shifts of position at most
_LARGEST_TURN = 0.3  # rad in one flow
_RANK = 1e-9  # relative singular value below which contacts press redundantly
_KINDS = 6  # rows that a contact can have: one of pressing, two of sliding, one of torsion, two of rolling


def hold_gripping(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    flow: Flow,
    look_again: Callable[[float], tuple[Moment, np.ndarray]],
    correct: Callable[[Arrival], Arrival],
) -> tuple[Arrival, Callable[[], Arrival]]:
    """Bring the position back to the sustained contacts; data and its frames change.

    Args:
        model: the scene.
        data: at the end of the flow, frames current.
        arrival: the contacts there.
        flow: what led there.
        look_again: detects the contacts of now up to a gap at least, m, and matches them with the start.
        correct: opens sustained contacts that overlap.

    Returns:
        The contacts after the correction, and what brings back the velocity, too, and returns them with that. Before it
        they have the velocity of the impulses that act where the flow has led: enough for a flow that is only tried.

    Raises:
        SolverError: no solver has found the impulses.
    """
    arrival.now.touch.whitened(model, data)
    felt = Felt.of(model, data, flow.start.force, flow.duration)
    free = constrained_velocity(model, data, arrival.now, flow) - felt.velocity
    impulse, grasp, carried = _press(model, data, arrival, flow, free, None)
    change = jump(model, data, grasp.along, impulse)
    shift = (moving_part(model) * flow.duration) * change - felt.shift
    if np.count_nonzero(shift):
        reach = arrival.now.touch.opening(shift + felt.shift)
        arrival, carried = _settle(model, data, arrival, shift, carried, flow, look_again, reach)
    arrival = _with_more(arrival, flow)
    if np.count_nonzero(arrival.sustained & (arrival.now.gap < -CORRECTED * flow.tolerance)):
        before, arrival = arrival.known, _with_more(correct(arrival), flow)
        carried = _matched(carried, before, arrival.known)
    now, known, sustained = arrival
    data.qvel[:] = free + change
    tried = Arrival(now._replace(contact_velocity=now.touch.contact_velocity(data.qvel)), known, sustained)
    return tried, partial(_hold_velocity, model, data, arrival, flow, felt, free, carried)


def _hold_velocity(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    flow: Flow,
    felt: Felt,
    free: np.ndarray,
    guess: np.ndarray,
) -> Arrival:
    """Give the sustained contacts the velocity that they have after impulses; return them with these impulses."""
    impulse, grasp, carried = _press(model, data, arrival, flow, free, guess)
    turned = _turned(model, data, arrival, flow, grasp)
    if turned is not None:
        free = free + jump(model, data, turned, 0.5 * impulse)
        impulse, grasp, carried = _press(model, data, arrival, flow, free, carried)
    change, total = jump(model, data, grasp.along, impulse), impulse.dot(grasp.along)
    data.qvel[:] = free + change
    now, known, sustained = arrival
    force = total / flow.duration if felt.is_settled(total, change) else None
    moment = now.moving(model, data, carried[:, 0] > 0, Carried(grasp, carried / flow.duration), force)
    return Arrival(moment, known, sustained)


def _with_more(arrival: Arrival, flow: Flow) -> Arrival:
    """Return the contacts with those sustained, too, that the others press closed now that they are held."""
    now, known, sustained = arrival
    return Arrival(now, known, sustained | stays(now.gap, known, flow))


def _settle(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    shift: np.ndarray,
    carried: np.ndarray,
    flow: Flow,
    look_again: Callable[[float], tuple[Moment, np.ndarray]],
    reach: float,
) -> tuple[Arrival, np.ndarray]:
    """Shift the bodies, and then so that contacts that press are closed; return the contacts and their impulses.

    They are looked for up to a gap of ``reach`` at least, m: surfaces may recede, too.
    """
    held = arrival.known[arrival.sustained]
    for _ in range(_SETTLINGS):
        qpos = data.qpos.copy()
        mujoco.mj_integratePos(model, qpos, shift, 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        before, (now, known) = arrival.known, look_again(max(reach, arrival.now.touch.opening(shift)))
        arrival = Arrival(now, known, (known[:, None] == held[held >= 0]).any(axis=1))
        carried = _matched(carried, before, known)
        press = np.flatnonzero(carried[:, 0] > 0)
        if np.abs(now.gap[press]).max(initial=0.0) <= CORRECTED * flow.tolerance:
            break
        along, Y, _ = now.touch.whitened(model, data)
        shift = jump(model, data, along[press], _opening(Y[press], -now.gap[press]))
    return arrival, carried


def _opening(gradients: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the least p with ``Y Y^T p = c``, (h,), in the sense of least squares."""
    if len(wanted) == 1 and (square := gradients[0].dot(gradients[0])) > 0:
        return wanted / square
    z = np.linalg.lstsq(gradients, wanted, rcond=_RANK)[0]
    return np.linalg.lstsq(gradients.T, z, rcond=_RANK)[0]


def _matched(carried: np.ndarray, before: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return impulses, (h, 6), in the order of other contacts; both orders are told by indices at the flow's start."""
    if np.array_equal(before, known):
        return carried
    result = np.zeros((len(known), _KINDS))
    for i, index in enumerate(known):
        same = np.flatnonzero(before == index)
        if index >= 0 and len(same):
            result[i] = carried[same[0]]
    return result


def _press(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    flow: Flow,
    free: np.ndarray,
    guess: np.ndarray | None,
) -> tuple[np.ndarray, Grasp, np.ndarray]:
    """Return the impulses of the sustained contacts, their rows, and the impulses contact by contact, (h, 6)."""
    now, before = arrival.now, flow.start.carried
    held = now.closed
    if flow.start.force is not None and before is not None:  # it may have pushed away what it has to pull back
        held = held | ((arrival.known >= 0) & (before.force[arrival.known, 0] > 0))
    grasp = grasp_of(model, data, now.touch, arrival.sustained & held, free)
    known = None
    if guess is not None and len(guess) == len(now.gap):
        known = guess[grasp.contact, grasp.kind]
    elif before is not None:
        index = arrival.known[grasp.contact]
        known = np.where(index >= 0, before.force[index, grasp.kind] * flow.duration, 0.0)
    impulse = solve_grasp(grasp, known, kinetic_norm(model, data, free), flow.work, exact=flow.exact)
    carried = np.zeros((len(now.gap), _KINDS))
    carried[grasp.contact, grasp.kind] = impulse
    return impulse, grasp, carried


def _turned(
    model: mujoco.MjModel, data: mujoco.MjData, arrival: Arrival, flow: Flow, grasp: Grasp
) -> np.ndarray | None:
    """Return the rows at the start of the flow less those of now, (n, nv); None if they are the same.

    Half of an impulse acts along the rows of the start (as in RATTLE), so that what turns about a contact that sticks
    keeps its energy to second order.
    """
    if flow.start.carried is None or not len(flow.start.carried.grasp.contact):
        return None
    before = flow.start.carried.grasp
    place = np.full((len(flow.start.gap), _KINDS), -1)
    place[before.contact, before.kind] = np.arange(len(before.contact))
    known = arrival.known[grasp.contact]
    row = np.where(known >= 0, place[known, grasp.kind], -1)
    difference = np.where(row[:, None] >= 0, before.along[row] - grasp.along, 0.0)
    if not np.count_nonzero(difference):
        return None
    difference, whitened = arrival.now.touch.confine(model, data, difference)
    change, length = np.vecdot(whitened, whitened), np.vecdot(grasp.whitened, grasp.whitened)
    difference[change > _LARGEST_TURN**2 * length] = 0.0  # another feature of the surface
    return difference if np.any(change > 1e-24 * length) else None


def grasp_of(model: mujoco.MjModel, data: mujoco.MjData, touch: Touch, held: np.ndarray, velocity: np.ndarray) -> Grasp:
    """Return the rows of some contacts, bool (h,), at a velocity, (nv,)."""
    contact, kind, jacobian, drift, along, whitened = touch.rows(model, data)
    rows = np.flatnonzero(held[contact])
    sizes = np.bincount(contact[rows], minlength=1)
    gamma = jacobian.dot(velocity) + drift
    return Grasp(contact[rows], kind[rows], sizes[sizes > 0], along[rows], whitened[rows], gamma[rows])


def solve_grasp(grasp: Grasp, guess: np.ndarray | None, speed: float, work: Work, *, exact: bool) -> np.ndarray:
    """Return the impulses with E = 0, (n,), those of friction divided by their coefficients.

    Raises:
        SolverError: no solver has found them.
        UnfinishedStepError: that takes too much work.
    """
    rows = len(grasp.contact)
    work.solve(rows, 0)
    problem = ConeProblem(grasp.whitened, grasp.velocity, grasp.sizes, exact=exact, speed=speed)
    answer = solve_cones(problem, guess, rounds=work.rounds(rows))
    work.solve(rows, answer.iterations)
    if answer.status is not Status.SOLVED:
        raise SolverError(
            f"no impulses of {len(grasp.sizes)} contacts with friction were found: relative residual "
            f'{answer.residual / problem.scale:.1e}; use a smaller timestep, or friction="convex"'
        )
    return answer.impulse
