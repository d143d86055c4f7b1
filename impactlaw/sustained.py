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

from impactlaw.contacts import Contacts, gap_gradients, kinetic_metric, update_positions
from impactlaw.errors import UnsolvableLawError
from impactlaw.flow import Frames
from impactlaw.metric import KineticMetric
from impactlaw.solvers import Problem, solve

_CORRECTIONS = 8  # position corrections at most; each gains digits, the curvature of the surfaces decides how many
_LARGEST_TURN = 0.3  # rad in one flow


@dataclass(frozen=True, eq=False)
class Start:
    """The contacts at the start of a flow, after every collision there is resolved.

    Attributes:
        contacts: those that were detected, open ones included.
        frames: of all geoms.
        jacobian: gap gradients, shape (h, nv).
        contact_velocity: ``gamma``, m/s, (h,).
        rounding: size of the rounding errors of gamma, m/s, (h,).
        velocity: qvel, (nv,).
    """

    contacts: Contacts
    frames: Frames
    jacobian: np.ndarray
    contact_velocity: np.ndarray
    rounding: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True, eq=False)
class Matches:
    """Which contact at the end of a flow is which one of its start.

    Attributes:
        start: index of the same contact at the start, or -1, int (h,).
        sustained: whether it stays closed, bool (h,).
    """

    start: np.ndarray
    sustained: np.ndarray


def match(contacts: Contacts, start: Start, data: mujoco.MjData, travel: np.ndarray, tolerance: float) -> np.ndarray:
    """Return for each contact at the end of a flow the index of the same contact at its start, or -1, int (h,).

    The same contact is of the same two geoms and has moved, seen from one of them, no further than they have travelled.
    """
    index = np.full(len(contacts), -1)
    before = start.contacts
    if len(before) == 0:
        return index
    for i in range(len(contacts)):
        geoms = contacts.geoms[i]
        same = np.flatnonzero((before.geoms == geoms).all(axis=1))
        if len(same):
            moved = _moved(contacts.position[i], geoms, before.position[same], start.frames, data)
            nearest = int(np.argmin(moved))
            if moved[nearest] <= 2.0 * travel[geoms].sum() + 1e3 * tolerance:
                index[i] = same[nearest]
    return index


def stays(gap: np.ndarray, known: np.ndarray, start: Start, duration: float, tolerance: float) -> np.ndarray:
    """Return which contacts are sustained if they end the flow with these gaps, bool (h,)."""
    result = known >= 0
    s = known[result]
    velocity, gap0 = start.contact_velocity[s], start.contacts.gap[s]
    closing = 2.0 * (gap0 + velocity * duration - gap[result])  # times duration^2
    slow = (velocity <= start.rounding[s]) | ((velocity * duration) ** 2 <= 2.0 * closing * tolerance)
    result[result] = (gap0 <= tolerance) & slow
    return result


def hold(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    contacts: Contacts,
    matches: Matches,
    start: Start,
    duration: float,
    tolerance: float,
    look: Callable[[], tuple[Contacts, np.ndarray]],
) -> tuple[Contacts, Matches]:
    """Bring position and velocity back to the sustained contacts; data and its frames change.

    Args:
        model: the scene.
        data: at the end of the flow, frames current.
        contacts: there.
        matches: of these contacts.
        start: of the flow.
        duration: of the flow, s.
        tolerance: gap tolerance, m.
        look: detects the contacts of now, and matches them with the start.

    Returns:
        The contacts after the correction, and their matches.
    """
    end = data.qpos.copy()
    shift = np.zeros(model.nv)
    known, sustained = matches.start, matches.sustained.copy()
    for _ in range(_CORRECTIONS):
        near = sustained | (known >= 0)
        chosen, growing = contacts.select(near), sustained[near]
        J = gap_gradients(model, data, chosen)
        metric = kinetic_metric(model, data)
        try:
            p, wanted = _position_impulse(metric, J, chosen, growing, shift, known[near], start, duration, tolerance)
        except UnsolvableLawError:
            break  # squeezed between bodies that cannot give way: nothing to correct
        sustained[near] = growing
        pressed = np.flatnonzero(growing)[p > 0]
        error = max(np.abs(chosen.gap[pressed]).max(initial=0.0), -chosen.gap[growing].min(initial=0.0))
        if error <= 1e-2 * tolerance:
            break
        shift = wanted
        qpos = end.copy()
        mujoco.mj_integratePos(model, qpos, shift, 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        held = known[sustained & (known >= 0)]
        contacts, known = look()
        sustained = np.isin(known, held)  # what the flow has decided stays decided
    matches = Matches(known, sustained)
    _hold_velocity(model, data, contacts, matches, start, tolerance)
    return contacts, matches


def _position_impulse(
    metric: KineticMetric,
    J: np.ndarray,
    contacts: Contacts,
    sustained: np.ndarray,
    shift: np.ndarray,
    known: np.ndarray,
    start: Start,
    duration: float,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the impulse of the sustained contacts and the shift, (nv,), that opens them; ``sustained`` may grow."""
    Y = metric.whiten_gradients(J)
    while True:
        rows = np.flatnonzero(sustained)
        p = solve(Problem(Y[rows], J[rows] @ shift - contacts.gap[rows]), tuple(contacts.labels[i] for i in rows))
        wanted = metric.unwhiten(p @ Y[rows])
        gap = contacts.gap + J @ (wanted - shift)
        more = stays(gap, known, start, duration, tolerance) & ~sustained
        if not more.any():
            return p, wanted
        sustained |= more


def _hold_velocity(
    model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts, matches: Matches, start: Start, tolerance: float
) -> None:
    held = matches.sustained & (contacts.gap <= tolerance)
    closed = contacts.select(held)
    J = gap_gradients(model, data, closed)
    metric = kinetic_metric(model, data)
    Y = metric.whiten_gradients(J)

    def pressing(velocity: np.ndarray) -> np.ndarray:
        return solve(Problem(Y, -(J @ velocity), -metric.whiten(velocity)), closed.labels)

    velocity = data.qvel.copy()
    nu = pressing(velocity)
    known = matches.start[held]
    turned = np.where(known[:, None] >= 0, start.jacobian[known] - J, 0.0)
    change = np.linalg.norm(metric.whiten_gradients(turned), axis=1)
    lengths = np.linalg.norm(Y, axis=1)
    turned[change > _LARGEST_TURN * lengths] = 0.0  # another feature of the surface, not a curved one
    if (change > 1e-12 * lengths).any():
        velocity += metric.unwhiten(0.5 * nu @ metric.whiten_gradients(turned))
        nu = pressing(velocity)
    data.qvel[:] = velocity + metric.unwhiten(nu @ Y)


def _moved(
    position: np.ndarray, geoms: np.ndarray, before: np.ndarray, frames: Frames, data: mujoco.MjData
) -> np.ndarray:
    """Distances of one contact point from earlier ones, seen from the geom for which they are smaller, (n,)."""
    distances = []
    for geom in geoms:
        now = data.geom_xmat[geom].reshape(3, 3).T @ (position - data.geom_xpos[geom])
        then = (before - frames.position[geom]) @ frames.rotation[geom]
        distances.append(np.linalg.norm(then - now, axis=1))
    return np.minimum(*distances)
