"""Contacts at one time and how they move; a flow from one such moment to the next; which contacts stay closed."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.stepping.event_driven.contact_set import ContactSet, kinetic_norm
from impactlaw.stepping.event_driven.travel import Travel
from impactlaw.stepping.work import Work

CORRECTED = 1e-2
"""Part of the gap tolerance to which positions are corrected."""

SILENT = 0.1
"""Part of the velocity that crosses next to nothing in a timestep which is rounding, whatever the scene's own is."""

_ROUNDING = 1e-13  # of a contact velocity in the kinetic metric, relative to the velocity of the whole scene
_STILL = 1e-3  # part of the gap tolerance that a velocity must cross in a timestep to be one


class ConeRows(NamedTuple):
    """Rows of the cone problem of some contacts: contact by contact, pressing first, friction times its coefficient.

    Attributes:
        contact: index of the contact of each row, int (n,).
        kind: 0 for pressing, 1 to 5 for friction, int (n,).
        sizes: rows of each contact that takes part, int.
        along: the rows along which impulses act, (n, nv).
        whitened: the same where the kinetic metric is Euclidean, (n, nv).
        velocity: of each row at a given velocity, (n,).
    """

    contact: np.ndarray
    kind: np.ndarray
    sizes: np.ndarray
    along: np.ndarray
    whitened: np.ndarray
    velocity: np.ndarray


class ContactForces(NamedTuple):
    """What a flow had to hold where there is friction.

    Attributes:
        cone_rows: the rows at its end.
        force: pressing, then friction divided by its coefficients, N or N m, (h, 6).
    """

    cone_rows: ConeRows
    force: np.ndarray


class ContactState(NamedTuple):
    """Contacts at one time, and how they move.

    Attributes:
        contact_set: the contacts that were detected, open ones included.
        closed: whose gap is at most the tolerance, bool (h,).
        still: contact velocity that crosses next to nothing in a timestep, m/s.
        velocity: qvel, (nv,).
        contact_velocity: ``gamma``, m/s, (h,).
        noise: size of the rounding errors of gamma, m/s, (h,).
        quiet: whether all contacts are closed, and neither move nor need a correction of position.
        active: contacts that the last flow had to hold, bool (h,); None if there were none.
        contact_forces: the forces with which it held them where there is friction; None if there were none.
        force: that these contacts exert on all degrees of freedom, N or N m, (nv,); None if it is not known.
        bend: b of ``gap + velocity t + b t^2`` over the last flow, m/s^2, (h,), 0 if unknown; None without any.
    """

    contact_set: ContactSet
    closed: np.ndarray
    still: float
    velocity: np.ndarray
    contact_velocity: np.ndarray
    noise: np.ndarray
    quiet: bool
    active: np.ndarray | None = None
    contact_forces: ContactForces | None = None
    bend: np.ndarray | None = None
    force: np.ndarray | None = None

    @classmethod
    def of(
        cls, model: mujoco.MjModel, data: mujoco.MjData, contact_set: ContactSet, *, tolerance: float, timestep: float
    ) -> ContactState:
        """Read the velocities of now; inertia must be that of the touch."""
        gap = contact_set.contacts.gap
        closed = gap <= tolerance
        still = _STILL * tolerance / timestep
        velocity, gamma, noise, silent = _motion(model, data, contact_set, SILENT * still)
        quiet = (
            silent
            and contact_set.pattern.friction_pattern is None
            and np.count_nonzero(closed & (gap >= -CORRECTED * tolerance)) == len(gap)
        )
        return cls(contact_set, closed, still, velocity, gamma, noise, quiet)

    @classmethod
    def without_motion(cls, contact_set: ContactSet, *, tolerance: float, timestep: float) -> ContactState:
        """Return contacts whose velocities are not looked at: all zero, until `moving` reads them."""
        none = np.zeros(contact_set.jacobian.shape[1])
        closed, rest = contact_set.contacts.gap <= tolerance, np.zeros(len(contact_set.contacts))
        return cls(contact_set, closed, _STILL * tolerance / timestep, none, rest, rest, False)

    def moving(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        active: np.ndarray | None = None,
        contact_forces: ContactForces | None = None,
        force: np.ndarray | None = None,
    ) -> ContactState:
        """Return the same contacts with the velocities of now."""
        velocity, gamma, noise, _ = _motion(model, data, self.contact_set, SILENT * self.still)
        motion = velocity, gamma, noise, False
        if np.count_nonzero(self.contact_set.pattern.vague):  # contact points may jump, and forces with them
            force = None
        return ContactState(
            self.contact_set, self.closed, self.still, *motion, active, contact_forces, self.bend, force
        )

    def bending(self, bend: np.ndarray) -> ContactState:
        """Return the same contacts after a flow that has bent their gaps, m/s^2, (h,)."""
        return self._replace(bend=bend)

    @property
    def gap(self) -> np.ndarray:
        """Gaps, m, (h,)."""
        return self.contact_set.contacts.gap

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
    model: mujoco.MjModel, data: mujoco.MjData, contact_set: ContactSet, silent: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Return v, gamma, its noise, and whether gamma is all noise."""
    velocity = data.qvel.copy()
    gamma = contact_set.contact_velocity(velocity)
    if not np.count_nonzero(np.abs(gamma) > silent):
        return velocity, gamma, silent * contact_set.pattern.ones, True
    _, _, lengths = contact_set.whitened(model, data)
    return velocity, gamma, (_ROUNDING * kinetic_norm(model, data, velocity)) * lengths, False


class Phase(NamedTuple):
    """A flow that has been tried.

    Attributes:
        start: where it began.
        duration: s.
        tolerance: gap up to which a contact is closed, m.
        travel: measures how far geoms have moved.
        hold_all: whether every contact that is closed at its end is held there (time stepping).
        smooth: whether it is known that contacts between faces have moved smoothly, however far.
        exact: whether friction is exact, or its convex relaxation.
        work: counts what the step has taken.
    """

    start: ContactState
    duration: float
    tolerance: float
    travel: Travel
    work: Work
    hold_all: bool = False
    smooth: bool = False
    exact: bool = True


class PhaseEnd(NamedTuple):
    """The contacts at the end of a flow.

    Attributes:
        now: those contacts, and how they move now.
        known: index of the same contact at the start, or -1, int (h,).
        sustained: which ones stay closed, bool (h,).
    """

    now: ContactState
    known: np.ndarray
    sustained: np.ndarray


def stays(gap: np.ndarray, known: np.ndarray, phase: Phase) -> np.ndarray:
    """Return which contacts are sustained if they end the flow with these gaps, bool (h,)."""
    if phase.hold_all:
        return gap <= phase.tolerance
    start, tau = phase.start, phase.duration
    closed = start.closed
    if not np.count_nonzero(closed):
        return np.zeros(len(known), dtype=bool)
    velocity = start.contact_velocity[known]
    slow = velocity <= start.rounding[known]
    held = (known >= 0) & closed[known]
    if np.count_nonzero(held & slow) == np.count_nonzero(held):
        return held
    closing = 2.0 * (start.gap[known] + velocity * tau - gap)  # times tau^2
    return held & (slow | ((velocity * tau) ** 2 <= 2.0 * closing * phase.tolerance))
