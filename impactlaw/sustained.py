"""Contacts that stay closed during a flow: which ones do, and the impulse that keeps them closed.

A contact is sustained over a flow of duration tau if it was closed at the start and either did not separate, or
separated so slowly that its rebound rises less than the gap tolerance, ``gamma^2 / (2 a) <= tolerance`` with a the
closing acceleration that the flow shows. This is also what ends a Zeno sequence of ever smaller bounces.

The flow itself knows no contact; afterwards position and velocity are brought back to the closed contacts
(as in RATTLE). With b the integrator's position weight (1/2 for RK4, 1 for Euler):

    position:  0 <= p  ⊥  gap >= 0,              q <- q + M^-1 J^T p,        Lambda = p / (b tau)
    velocity:  0 <= nu ⊥  J (w + M^-1 J^T nu) >= 0,   w = v + M^-1 (J_start - J)^T Lambda / 2,   v <- w + M^-1 J^T nu

The term with ``J_start - J`` gives half of the impulse the direction it had at the start of the flow, so that RK4
keeps second order along curved surfaces; on flat ones it vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw.contacts import Contacts, detect, gap_gradients, kinetic_metric, update_positions
from impactlaw.errors import UnsolvableLawError
from impactlaw.flow import Frames, position_weight
from impactlaw.solvers import Problem, solve

_CORRECTIONS = 8  # position corrections at most; each gains digits, the curvature of the surfaces decides how many


@dataclass(frozen=True, eq=False)
class Start:
    """The contacts at the start of a flow, after every collision there is resolved.

    Attributes:
        contacts: those that were detected, open ones included.
        frames: of all geoms.
        jacobian: gap gradients, shape (h, nv).
        contact_velocity: ``gamma``, m/s, (h,).
        rounding: size of the rounding errors of gamma, m/s, (h,).
    """

    contacts: Contacts
    frames: Frames
    jacobian: np.ndarray
    contact_velocity: np.ndarray
    rounding: np.ndarray


@dataclass(frozen=True, eq=False)
class Matches:
    """Which contact at the end of a flow is which one of its start.

    Attributes:
        start: index of the same contact at the start, or -1, int (h,).
        sustained: whether it stayed closed, bool (h,).
    """

    start: np.ndarray
    sustained: np.ndarray


def match(
    contacts: Contacts, start: Start, data: mujoco.MjData, travel: np.ndarray, duration: float, tolerance: float
) -> Matches:
    """Compare contacts at the end of a flow with its start.

    The same contact is of the same two geoms and has moved, seen from one of them, no further than they have travelled.
    """
    h = len(contacts)
    index, sustained = np.full(h, -1), np.zeros(h, dtype=bool)
    before = start.contacts
    if len(before) == 0:
        return Matches(index, sustained)
    for i in np.flatnonzero(contacts.gap <= tolerance):
        same = np.flatnonzero((before.geoms == contacts.geoms[i]).all(axis=1))
        if len(same) == 0:
            continue
        moved = _moved(contacts.position[i], contacts.geoms[i], before.position[same], start.frames, data)
        nearest = int(np.argmin(moved))
        if moved[nearest] > 2.0 * travel[contacts.geoms[i]].sum() + 1e3 * tolerance:
            continue
        s = index[i] = same[nearest]
        sustained[i] = _stays(before.gap[s], contacts.gap[i], start.contact_velocity[s], start.rounding[s], duration, tolerance)
    return Matches(index, sustained)


def hold(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    contacts: Contacts,
    matches: Matches,
    start: Start,
    duration: float,
    tolerance: float,
    within: float,
    rematch,
) -> tuple[Contacts, Matches]:
    """Bring position and velocity back to the sustained contacts; data and its frames change.

    Args:
        contacts: at the end of the flow.
        matches: of these contacts.
        start: of the flow.
        duration: of the flow, s.
        tolerance: gap tolerance, m.
        within: detection distance, m.
        rematch: function from contacts to `Matches`, for the contacts after a correction.

    Returns:
        The contacts after the correction, and their matches.
    """
    correction = None
    for _ in range(_CORRECTIONS):
        deepest = -contacts.gap[matches.sustained].min(initial=0.0)
        if deepest <= 1e-2 * tolerance:
            break
        near = matches.sustained | ((contacts.gap >= 0) & (contacts.gap <= 4.0 * deepest))
        J = gap_gradients(model, data, contacts.select(near))
        metric = kinetic_metric(model, data)
        Y = metric.whiten_gradients(J)
        try:
            p = solve(Problem(Y, -contacts.gap[near]), contacts.select(near).labels)
        except UnsolvableLawError:
            break  # squeezed between bodies that cannot give way: nothing to correct
        if correction is None:
            known = matches.start[near]
            earlier = np.where(known[:, None] >= 0, start.jacobian[np.maximum(known, 0)], J)
            half = 0.5 * p / (position_weight(model) * duration)
            correction = metric.unwhiten(half @ metric.whiten_gradients(earlier - J))
        qpos = data.qpos.copy()
        mujoco.mj_integratePos(model, qpos, metric.unwhiten(p @ Y), 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        held = matches.start[matches.sustained & (matches.start >= 0)]
        contacts = detect(model, data, within)
        matches = rematch(contacts)
        matches.sustained[np.isin(matches.start, held)] = True  # what the flow has decided stays decided
    _hold_velocity(model, data, contacts.select(matches.sustained), correction)
    return contacts, matches


def _hold_velocity(model: mujoco.MjModel, data: mujoco.MjData, held: Contacts, correction: np.ndarray | None) -> None:
    w = data.qvel if correction is None else data.qvel + correction
    J = gap_gradients(model, data, held)
    metric = kinetic_metric(model, data)
    Y = metric.whiten_gradients(J)
    nu = solve(Problem(Y, -(J @ w), -metric.whiten(w)), held.labels)
    data.qvel[:] = w + metric.unwhiten(nu @ Y)


def _moved(position: np.ndarray, geoms: np.ndarray, before: np.ndarray, frames: Frames, data: mujoco.MjData) -> np.ndarray:
    """Distances of one contact point from earlier ones, seen from the geom for which they are smaller, (n,)."""
    distances = []
    for geom in geoms:
        now = data.geom_xmat[geom].reshape(3, 3).T @ (position - data.geom_xpos[geom])
        then = (before - frames.position[geom]) @ frames.rotation[geom]
        distances.append(np.linalg.norm(then - now, axis=1))
    return np.minimum(*distances)


def _stays(gap0: float, gap1: float, velocity: float, rounding: float, duration: float, tolerance: float) -> bool:
    if gap0 > tolerance:
        return False
    if velocity <= rounding:
        return True
    acceleration = 2.0 * (gap0 + velocity * duration - gap1) / duration**2
    return velocity**2 <= 2.0 * acceleration * tolerance
