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
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.contacts import Contacts, gap_gradients, update_positions
from impactlaw.errors import UnsolvableLawError
from impactlaw.flow import Frames, Travel
from impactlaw.solvers import Problem, solve
from impactlaw.touch import Touch, jump, kinetic_norm, whiten, whiten_gradients

_CORRECTIONS = 20  # position corrections at most
_SMOOTH_CORRECTIONS = 3  # that smooth surfaces need; each gains digits, their curvature decides how many
_CORRECTED = 1e-2  # part of the gap tolerance to which positions are corrected
_LARGEST_TURN = 0.3  # rad in one flow
_SAME_POINT = 1e3  # gap tolerances that a contact point may move more than the geoms
_ROUNDING = 1e-13  # of a contact velocity in the kinetic metric, relative to the velocity of the whole scene
_SILENT = 0.1  # part of that velocity which is rounding whatever the scene's own velocity is
_STILL = 1e-3  # part of the gap tolerance that a velocity must cross in a timestep to be one


class Moment(NamedTuple):
    """Contacts at one time, and how they move.

    Attributes:
        touch: the contacts that were detected, open ones included.
        closed: whose gap is at most the tolerance, bool (h,).
        still: contact velocity that crosses next to nothing in a timestep, m/s.
        velocity: qvel, (nv,).
        contact_velocity: ``gamma``, m/s, (h,).
        noise: size of the rounding errors of gamma, m/s, (h,).
        quiet: whether all contacts are closed, and neither move nor need a correction of position.
    """

    touch: Touch
    closed: np.ndarray
    still: float
    velocity: np.ndarray
    contact_velocity: np.ndarray
    noise: np.ndarray
    quiet: bool

    @classmethod
    def of(
        cls, model: mujoco.MjModel, data: mujoco.MjData, touch: Touch, *, tolerance: float, timestep: float
    ) -> Moment:
        """Read the velocities of now; inertia must be that of the touch."""
        gap = touch.contacts.gap
        closed = gap <= tolerance
        still = _STILL * tolerance / timestep
        velocity, gamma, noise, silent = _motion(model, data, touch, _SILENT * still)
        quiet = silent and np.count_nonzero(closed & (gap >= -_CORRECTED * tolerance)) == len(gap)
        return cls(touch, closed, still, velocity, gamma, noise, quiet)

    def moving(self, model: mujoco.MjModel, data: mujoco.MjData) -> Moment:
        """Return the same contacts with the velocities of now."""
        velocity, gamma, noise, _ = _motion(model, data, self.touch, _SILENT * self.still)
        return Moment(self.touch, self.closed, self.still, velocity, gamma, noise, False)

    @property
    def gap(self) -> np.ndarray:
        """Gaps, m, (h,)."""
        return self.touch.contacts.gap

    @property
    def rounding(self) -> np.ndarray:
        """Contact velocities below which there is no telling motion from rounding, m/s, (h,)."""
        return np.maximum(self.noise, self.still)

    @property
    def collides(self) -> bool:
        """Whether a closed contact approaches."""
        fast = self.closed & (self.contact_velocity < -self.still)
        return bool(np.count_nonzero(fast)) and bool(np.any(self.contact_velocity[fast] < -self.noise[fast]))


def _motion(
    model: mujoco.MjModel, data: mujoco.MjData, touch: Touch, silent: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Return v, gamma, its noise, and whether gamma is all noise."""
    velocity = data.qvel.copy()
    gamma = touch.jacobian.dot(velocity)
    if not np.count_nonzero(np.abs(gamma) > silent):
        return velocity, gamma, silent * touch.pattern.ones, True
    _, lengths = touch.whitened(model, data)
    return velocity, gamma, (_ROUNDING * kinetic_norm(model, data, velocity)) * lengths, False


class Flow(NamedTuple):
    """A flow that has been tried.

    Attributes:
        start: where it began.
        duration: s.
        tolerance: gap up to which a contact is closed, m.
        travel: measures how far geoms have moved.
        hold_all: whether every contact that is closed at its end is held there (time stepping).
        smooth: whether it is known that contacts between faces have moved smoothly, however far.
    """

    start: Moment
    duration: float
    tolerance: float
    travel: Travel
    hold_all: bool = False
    smooth: bool = False


class Arrival(NamedTuple):
    """The contacts at the end of a flow.

    Attributes:
        now: those contacts, and how they move now.
        known: index of the same contact at the start, or -1, int (h,).
        sustained: which ones stay closed, bool (h,).
    """

    now: Moment
    known: np.ndarray
    sustained: np.ndarray


def match(model: mujoco.MjModel, data: mujoco.MjData, touch: Touch, flow: Flow) -> np.ndarray:
    """Return for each contact at the end of a flow the index of the same contact at its start, or -1, int (h,).

    The same contact is of the same two geoms and has moved, seen from one of them, no further than they have travelled.
    If the two never have more than one contact, it is the same one anyway. If they touch somewhere in common faces, it
    continues the nearest contact that was closed if, at the start, it approached no faster than the flow has changed
    its velocity (an impact so slow is over within the flow), or if the flow is known to be smooth.
    """
    before, now = flow.start.touch.pattern, touch.pattern
    if not before or not now:
        return np.full(len(now), -1)
    if before.all_single and now.all_single:
        if before is now:
            return now.index
        index = np.minimum(np.searchsorted(before.key, now.key), len(before) - 1)
        return np.where(before.key[index] == now.key, index, -1)
    if before is now:
        moved = np.abs(touch.contacts.position - flow.start.touch.contacts.position).max()
        if moved <= _SAME_POINT * flow.tolerance:
            return now.index
    return _match_points(model, data, touch, flow)


def _match_points(model: mujoco.MjModel, data: mujoco.MjData, touch: Touch, flow: Flow) -> np.ndarray:
    start, contacts = flow.start, touch.contacts
    before = start.touch.contacts
    index = np.full(len(contacts), -1)
    other = touch.pattern.key[:, None] != start.touch.pattern.key
    moved = np.where(other, np.inf, _moved(contacts, before, start.touch.frames, data))
    nearest = moved.argmin(axis=1)
    least = moved[np.arange(len(contacts)), nearest]
    travel = flow.travel.between(start.touch.frames, data)
    near = least <= 2.0 * travel[contacts.geoms].sum(axis=1) + _SAME_POINT * flow.tolerance
    near |= np.isfinite(least) & touch.pattern.single
    index[near] = nearest[near]
    moved[:, ~start.closed | (start.contact_velocity > start.rounding)] = np.inf
    vague = np.flatnonzero(~near & np.isfinite(moved).any(axis=1) & touch.pattern.vague)
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
    start, tau = flow.start, flow.duration
    closed = start.closed
    if not np.count_nonzero(closed):
        return np.zeros(len(known), dtype=bool)
    velocity = start.contact_velocity[known]
    slow = velocity <= start.rounding[known]
    held = (known >= 0) & closed[known]
    if np.count_nonzero(held & slow) == np.count_nonzero(held):
        return held
    closing = 2.0 * (start.gap[known] + velocity * tau - gap)  # times tau^2
    return held & (slow | ((velocity * tau) ** 2 <= 2.0 * closing * flow.tolerance))


def hold(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    flow: Flow,
    look_again: Callable[[], tuple[Moment, np.ndarray]],
) -> Arrival:
    """Bring position and velocity back to the sustained contacts; data and its frames change.

    Args:
        model: the scene.
        data: at the end of the flow, frames current.
        arrival: the contacts there.
        flow: what led there.
        look_again: detects the contacts of now, and matches them with the start.

    Returns:
        The contacts after the correction.
    """
    if np.count_nonzero(arrival.sustained & (arrival.now.gap < -_CORRECTED * flow.tolerance)):
        arrival = _hold_position(model, data, arrival, flow, look_again)
    now, known, sustained = arrival
    if np.count_nonzero(sustained & now.closed & (now.contact_velocity < -now.noise)):
        _hold_velocity(model, data, arrival, flow)
        return Arrival(now.moving(model, data), known, sustained)
    return arrival


def _hold_position(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    flow: Flow,
    look_again: Callable[[], tuple[Moment, np.ndarray]],
) -> Arrival:
    end = data.qpos.copy()
    shift = np.zeros(model.nv)
    cuts = np.zeros((0, model.nv)), np.zeros(0)
    for correction in range(_CORRECTIONS):
        now, known, sustained = arrival
        touch = now.touch
        try:
            sustained, pressed, wanted = _position_impulse(model, data, arrival, shift, flow, cuts)
        except UnsolvableLawError:
            break  # squeezed between bodies that cannot give way: nothing to correct
        if not np.count_nonzero(pressed) and not shift.any():
            return Arrival(now, known, sustained)
        if correction >= _SMOOTH_CORRECTIONS:  # the contacts jump between points of a face: keep them all
            rows = touch.jacobian[sustained], touch.jacobian[sustained] @ shift - touch.contacts.gap[sustained]
            cuts = np.vstack([cuts[0], rows[0]]), np.concatenate([cuts[1], rows[1]])
        shift = wanted
        qpos = end.copy()
        mujoco.mj_integratePos(model, qpos, shift, 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        held, pressing = known[sustained & (known >= 0)], known[pressed & (known >= 0)]
        now, known = look_again()
        sustained = _among(known, held)  # what the flow has decided stays decided
        arrival = Arrival(now, known, sustained)
        gap = now.gap
        error = max(np.abs(gap[_among(known, pressing)]).max(initial=0.0), -gap[sustained].min(initial=0.0))
        if error <= _CORRECTED * flow.tolerance and not np.count_nonzero(stays(gap, known, flow) & ~sustained):
            break
    return arrival


def _among(known: np.ndarray, some: np.ndarray) -> np.ndarray:
    return (known[:, None] == some).any(axis=1)


def _position_impulse(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    arrival: Arrival,
    shift: np.ndarray,
    flow: Flow,
    cuts: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which contacts are sustained, which of them press, and the shift, (nv,), that opens them.

    The cuts are gradients and least shifts along them of contacts that were seen there before.
    """
    touch, sustained = arrival.now.touch, arrival.sustained
    gap, J = touch.contacts.gap, touch.jacobian
    while True:
        rows = np.flatnonzero(sustained)
        gradients, least, Y = J[rows], J[rows].dot(shift) - gap[rows], touch.whitened(model, data)[0][rows]
        if len(cuts[1]):
            gradients, least = np.vstack([gradients, cuts[0]]), np.concatenate([least, cuts[1]])
            Y = np.vstack([Y, whiten_gradients(model, data, cuts[0])])
        p = solve(Problem(Y, least), tuple(map(str, range(len(least)))))
        wanted = jump(model, data, gradients, p)
        more = stays(gap + J.dot(wanted - shift), arrival.known, flow) & ~sustained
        if not np.count_nonzero(more):
            pressed = np.zeros(len(gap), dtype=bool)
            pressed[rows[p[: len(rows)] > 0]] = True
            return sustained, pressed, wanted
        sustained = sustained | more


def _hold_velocity(model: mujoco.MjModel, data: mujoco.MjData, arrival: Arrival, flow: Flow) -> None:
    touch, start = arrival.now.touch, flow.start.touch
    held = np.flatnonzero(arrival.sustained & arrival.now.closed)
    Y, lengths = touch.whitened(model, data)
    J, Y, lengths = touch.jacobian[held], Y[held], lengths[held]
    velocity = data.qvel.copy()
    labels = tuple(touch.contacts.labels[i] for i in held)

    def pressing(velocity: np.ndarray) -> np.ndarray:
        return solve(Problem(Y, -J.dot(velocity), -whiten(model, data, velocity)), labels)

    nu = pressing(velocity)
    if not nu.any():
        return
    known = arrival.known[held]
    difference = np.where(known[:, None] >= 0, start.jacobian[known] - J, 0.0) if start.pattern else J - J
    if difference.any():
        turned = whiten_gradients(model, data, difference)
        change = np.sqrt(np.vecdot(turned, turned))
        difference[change > _LARGEST_TURN * lengths] = 0.0  # another feature of the surface, not a curved one
        if (change > 1e-12 * lengths).any():
            velocity += jump(model, data, difference, 0.5 * nu)
            nu = pressing(velocity)
    data.qvel[:] = velocity + jump(model, data, J, nu)


def _moved(contacts: Contacts, before: Contacts, frames: Frames, data: mujoco.MjData) -> np.ndarray:
    """Distances of contact points from earlier ones, seen from that of the two geoms for which they are smaller."""
    distances = []
    for geom, geom_before in zip(contacts.geoms.T, before.geoms.T, strict=True):
        turn = data.geom_xmat[geom].reshape(-1, 3, 3)
        now = np.einsum("hij,hi->hj", turn, contacts.position - data.geom_xpos[geom])
        then = np.einsum(
            "hij,hi->hj", frames.rotation[geom_before].reshape(-1, 3, 3), before.position - frames.position[geom_before]
        )
        distances.append(np.linalg.norm(now[:, None] - then, axis=2))
    return np.minimum(*distances)
