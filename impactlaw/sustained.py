"""Contacts that stay closed during a flow: which ones do, and the impulse that keeps them closed.

A contact is sustained over a flow of duration tau if it was closed at the start and either did not separate, or
separated so slowly that its rebound rises less than the gap tolerance, ``gamma^2 / (2 a) <= tolerance`` with a the
closing acceleration that the flow shows. This is also what ends a Zeno sequence of ever smaller bounces. The
acceleration of a contact is looked at again once those below it are held: in a stack that falls freely it is zero.

The flow itself knows no contact; afterwards position and velocity are brought back to the closed contacts:

    position:  min |d|,  gap(q + d) >= 0           (kinetic metric; Gauss-Newton on the gaps)
    velocity:  0 <= nu  ⊥  J (w + M^-1 J^T nu) >= 0,   w = v + M^-1 (J_start - J)^T nu' / 2,   v <- w + M^-1 J^T nu

where nu' solves the second line with w = v. The term with ``J_start - J`` gives half of the impulse the direction it
had at the start of the flow (as in RATTLE), so that RK4 keeps second order along curved surfaces; on flat ones it
vanishes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw.contacts import Contacts, Touch, gap_gradients, update_positions
from impactlaw.errors import UnsolvableLawError
from impactlaw.flow import Frames
from impactlaw.geoms import one_contact, vague_contacts
from impactlaw.solvers import Problem, solve

_CORRECTIONS = 20  # position corrections at most
_SMOOTH_CORRECTIONS = 3  # that smooth surfaces need; each gains digits, their curvature decides how many
_CORRECTED = 1e-2  # part of the gap tolerance to which positions are corrected
_LARGEST_TURN = 0.3  # rad in one flow
_SAME_POINT = 1e3  # gap tolerances that a contact point may move more than the geoms


@dataclass(frozen=True, eq=False)
class Start:
    """The contacts at the start of a flow, after every collision there is resolved.

    Attributes:
        touch: the contacts that were detected, open ones included.
        frames: of all geoms.
        velocity: qvel, (nv,).
        contact_velocity: ``gamma``, m/s, (h,).
        rounding: size of the rounding errors of gamma, m/s, (h,).
    """

    touch: Touch
    frames: Frames
    velocity: np.ndarray
    contact_velocity: np.ndarray
    rounding: np.ndarray

    @property
    def gap(self) -> np.ndarray:
        """Gaps, m, (h,)."""
        return self.touch.contacts.gap


@dataclass(frozen=True, eq=False)
class Flow:
    """A flow that has been tried.

    Attributes:
        start: where it began.
        duration: s.
        travel: a bound on the travel of each geom, m, (ngeom,).
        tolerance: gap up to which a contact is closed, m.
        hold_all: whether every contact that is closed at its end is held there (time stepping).
        smooth: whether it is known that contacts between faces have moved smoothly, however far.
    """

    start: Start
    duration: float
    travel: np.ndarray
    tolerance: float
    hold_all: bool = False
    smooth: bool = False


@dataclass(frozen=True, eq=False)
class Arrival:
    """The contacts at the end of a flow.

    Attributes:
        touch: those contacts.
        known: index of the same contact at the start, or -1, int (h,).
        sustained: which ones stay closed, bool (h,).
    """

    touch: Touch
    known: np.ndarray
    sustained: np.ndarray


def match(model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts, flow: Flow) -> np.ndarray:
    """Return for each contact at the end of a flow the index of the same contact at its start, or -1, int (h,).

    The same contact is of the same two geoms and has moved, seen from one of them, no further than they have travelled.
    If the two never have more than one contact, it is the same one anyway. If they touch somewhere in common faces, it
    continues the nearest contact that was closed if, at the start, it approached no faster than the flow has changed
    its velocity (an impact so slow is over within the flow), or if the flow is known to be smooth.
    """
    start = flow.start
    before = start.touch.contacts
    index = np.full(len(contacts), -1)
    if len(before) == 0 or len(contacts) == 0:
        return index
    other = (contacts.geoms[:, None] != before.geoms).any(axis=2)
    moved = np.where(other, np.inf, _moved(contacts, before, start.frames, data))
    nearest = moved.argmin(axis=1)
    least = moved[np.arange(len(contacts)), nearest]
    near = least <= 2.0 * flow.travel[contacts.geoms].sum(axis=1) + _SAME_POINT * flow.tolerance
    near |= np.isfinite(least) & one_contact(model, contacts.geoms)
    index[near] = nearest[near]
    moved[:, (start.gap > flow.tolerance) | (start.contact_velocity > start.rounding)] = np.inf
    vague = np.flatnonzero(~near & np.isfinite(moved).any(axis=1) & vague_contacts(model, contacts.geoms))
    if len(vague) and not flow.smooth:
        J = gap_gradients(model, data, contacts.select(vague))
        velocity, change = J @ start.velocity, J @ (data.qvel - start.velocity)
        vague = vague[-velocity <= np.abs(change) + start.rounding.max()]
    index[vague] = moved[vague].argmin(axis=1)
    return index


def stays(gap: np.ndarray, known: np.ndarray, flow: Flow) -> np.ndarray:
    """Return which contacts are sustained if they end the flow with these gaps, bool (h,)."""
    if flow.hold_all:
        return gap <= flow.tolerance
    result = known >= 0
    s, start, tau = known[result], flow.start, flow.duration
    velocity, gap0 = start.contact_velocity[s], start.gap[s]
    closing = 2.0 * (gap0 + velocity * tau - gap[result])  # times tau^2
    slow = (velocity <= start.rounding[s]) | ((velocity * tau) ** 2 <= 2.0 * closing * flow.tolerance)
    result[result] = (gap0 <= flow.tolerance) & slow
    return result


def hold(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    flow: Flow,
    look: Callable[[], tuple[Touch, np.ndarray]],
) -> Arrival:
    """Bring position and velocity back to the sustained contacts; data and its frames change.

    Args:
        model: the scene.
        data: at the end of the flow, frames current.
        arrival: the contacts there.
        flow: what led there.
        look: detects the contacts of now, and matches them with the start.

    Returns:
        The contacts after the correction.
    """
    end = data.qpos.copy()
    shift = np.zeros(model.nv)
    cuts = np.zeros((0, model.nv)), np.zeros(0)
    for correction in range(_CORRECTIONS):
        touch, known, sustained = arrival.touch, arrival.known, arrival.sustained
        try:
            sustained, pressed, wanted = _position_impulse(arrival, shift, flow, cuts)
        except UnsolvableLawError:
            break  # squeezed between bodies that cannot give way: nothing to correct
        if not pressed.any() and not shift.any():
            arrival = Arrival(touch, known, sustained)
            break
        if correction >= _SMOOTH_CORRECTIONS:  # the contacts jump between points of a face: keep them all
            rows = touch.gradients[sustained], touch.jacobian[sustained] @ shift - touch.contacts.gap[sustained]
            cuts = np.vstack([cuts[0], rows[0]]), np.concatenate([cuts[1], rows[1]])
        shift = wanted
        qpos = end.copy()
        mujoco.mj_integratePos(model, qpos, shift, 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        held, pressing = known[sustained & (known >= 0)], known[pressed & (known >= 0)]
        touch, known = look()
        sustained = np.isin(known, held)  # what the flow has decided stays decided
        arrival = Arrival(touch, known, sustained)
        gap = touch.contacts.gap
        error = max(np.abs(gap[np.isin(known, pressing)]).max(initial=0.0), -gap[sustained].min(initial=0.0))
        if error <= _CORRECTED * flow.tolerance and not (stays(gap, known, flow) & ~sustained).any():
            break
    _hold_velocity(data, arrival, flow)
    return arrival


def _position_impulse(
    arrival: Arrival, shift: np.ndarray, flow: Flow, cuts: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which contacts are sustained, which of them press, and the shift, (nv,), that opens them.

    The cuts are gradients and least shifts along them of contacts that were seen there before.
    """
    touch, sustained = arrival.touch, arrival.sustained.copy()
    gap, J, Y = touch.contacts.gap, touch.jacobian, touch.gradients
    while True:
        rows = np.flatnonzero(sustained)
        gradients = np.vstack([Y[rows], cuts[0]])
        least = np.concatenate([J[rows] @ shift - gap[rows], cuts[1]])
        p = solve(Problem(gradients, least), tuple(map(str, range(len(least)))))
        wanted = touch.metric.unwhiten(p @ gradients)
        more = stays(gap + J @ (wanted - shift), arrival.known, flow) & ~sustained
        if not more.any():
            pressed = np.zeros(len(gap), dtype=bool)
            pressed[rows[p[: len(rows)] > 0]] = True
            return sustained, pressed, wanted
        sustained |= more


def _hold_velocity(data: mujoco.MjData, arrival: Arrival, flow: Flow) -> None:
    touch, start = arrival.touch, flow.start
    held = np.flatnonzero(arrival.sustained & (touch.contacts.gap <= flow.tolerance))
    J, Y, metric = touch.jacobian[held], touch.gradients[held], touch.metric
    labels = tuple(touch.contacts.labels[i] for i in held)

    def pressing(velocity: np.ndarray) -> np.ndarray:
        return solve(Problem(Y, -(J @ velocity), -metric.whiten(velocity)), labels)

    velocity = data.qvel.copy()
    nu = pressing(velocity)
    if not nu.any():
        return
    known = arrival.known[held]
    turned = metric.whiten_gradients(np.where(known[:, None] >= 0, start.touch.jacobian[known] - J, 0.0))
    change, lengths = np.linalg.norm(turned, axis=1), np.linalg.norm(Y, axis=1)
    turned[change > _LARGEST_TURN * lengths] = 0.0  # another feature of the surface, not a curved one
    if (change > 1e-12 * lengths).any():
        velocity += metric.unwhiten(0.5 * nu @ turned)
        nu = pressing(velocity)
    data.qvel[:] = velocity + metric.unwhiten(nu @ Y)


def _moved(contacts: Contacts, before: Contacts, frames: Frames, data: mujoco.MjData) -> np.ndarray:
    """Distances of contact points from earlier ones, seen from that of the two geoms for which they are smaller."""
    distances = []
    for geom, geom_before in zip(contacts.geoms.T, before.geoms.T, strict=True):
        turn = data.geom_xmat[geom].reshape(-1, 3, 3)
        now = np.einsum("hij,hi->hj", turn, contacts.position - data.geom_xpos[geom])
        then = np.einsum("hij,hi->hj", frames.rotation[geom_before], before.position - frames.position[geom_before])
        distances.append(np.linalg.norm(now[:, None] - then, axis=2))
    return np.minimum(*distances)
