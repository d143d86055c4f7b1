"""Contacts that stay closed during a flow: which ones do, and the impulse that keeps them closed.

A contact is sustained over a flow of duration tau if it was closed at the start and either did not separate, or
separated so slowly that its rebound rises less than the gap tolerance, ``gamma^2 / (2 a) <= tolerance`` with a the
closing acceleration that the flow shows. This is also what ends a Zeno sequence of ever smaller bounces.

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
    contacts: Contacts, start: Start, data: mujoco.MjData, travel: np.ndarray, duration: float, tolerance: float, upto: float
) -> Matches:
    """Compare contacts at the end of a flow with its start.

    The same contact is of the same two geoms and has moved, seen from one of them, no further than they have travelled.
    Contacts with a gap above ``upto`` are left unmatched.
    """
    h = len(contacts)
    index, sustained = np.full(h, -1), np.zeros(h, dtype=bool)
    before = start.contacts
    if len(before) == 0:
        return Matches(index, sustained)
    for i in np.flatnonzero(contacts.gap <= upto):
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
    tolerance: float,
    look: Callable[[float], tuple[Contacts, Matches]],
) -> tuple[Contacts, Matches]:
    """Bring position and velocity back to the sustained contacts; data and its frames change.

    Args:
        model: the scene.
        data: at the end of the flow, frames current.
        contacts: there.
        matches: of these contacts.
        start: of the flow.
        tolerance: gap tolerance, m.
        look: detects and matches the contacts of now, those up to a gap.

    Returns:
        The contacts after the correction, and their matches.
    """
    end = data.qpos.copy()
    shift = np.zeros(model.nv)
    deepest = float(-contacts.gap[matches.sustained].min(initial=0.0))
    for _ in range(_CORRECTIONS):
        near = matches.sustained | ((contacts.gap >= 0) & (contacts.gap <= 4.0 * deepest))
        chosen = contacts.select(near)
        J = gap_gradients(model, data, chosen)
        metric = kinetic_metric(model, data)
        Y = metric.whiten_gradients(J)
        try:
            p = solve(Problem(Y, J @ shift - chosen.gap), chosen.labels)
        except UnsolvableLawError:
            break  # squeezed between bodies that cannot give way: nothing to correct
        pressed = p > 0
        error = max(np.abs(chosen.gap[pressed]).max(initial=0.0), -chosen.gap.min(initial=0.0))
        if error <= 1e-2 * tolerance:
            break
        shift = metric.unwhiten(p @ Y)
        qpos = end.copy()
        mujoco.mj_integratePos(model, qpos, shift, 1.0)
        data.qpos[:] = qpos
        update_positions(model, data)
        held = matches.start[matches.sustained & (matches.start >= 0)]
        contacts, matches = look(max(tolerance, deepest))
        matches.sustained[:] = np.isin(matches.start, held)  # what the flow has decided stays decided
    _hold_velocity(model, data, contacts, matches, start, tolerance)
    return contacts, matches


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
