"""Contacts at one time and how they move; the smooth phase from there; which contacts stay closed in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlaw.scene.contacts import Contacts
from impactlaw.scene.patterns import Pattern
from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.contact_set import ContactSet, Rows
from impactlaw.stepping.event_driven.location.travel import Frames, Travel
from impactlaw.stepping.work import Work

CORRECTED = 1e-2
"""Part of the gap tolerance to which positions are corrected."""

SILENT = 0.1
"""Part of the velocity that crosses next to nothing in a timestep which is rounding, whatever the scene's own is."""

_ROUNDING = 1e-13  # of a contact velocity in the kinetic metric, relative to the velocity of the whole scene
_STILL = 1e-3  # part of the gap tolerance that a velocity must cross in a timestep to be one


class ContactForces(NamedTuple):
    """The forces with which a phase has held contacts with friction."""

    rows: Rows  # those of the contacts, at its end
    force: np.ndarray  # normal force, then friction divided by its coefficients, N or N m, (h, 6)


class ContactState(NamedTuple):
    """Contacts at one time, and how they move."""

    contact_set: ContactSet  # the contacts that were detected, open ones included
    closed: np.ndarray  # whose gap is at most the tolerance, bool (h,)
    still: float  # contact velocity that crosses next to nothing in a timestep, m/s
    velocity: np.ndarray  # qvel, (nv,)
    contact_velocity: np.ndarray  # ``gamma``, m/s, (h,)
    noise: np.ndarray  # size of the rounding errors of gamma, m/s, (h,)
    quiet: bool  # whether all contacts are closed, and neither move nor need a correction of position
    active: np.ndarray | None = None  # contacts that the last phase had to hold, bool (h,); None if there were none
    # the forces with which it held them where there is friction; None if there were none
    contact_forces: ContactForces | None = None
    # that these contacts exert on all degrees of freedom, N or N m, (nv,); None if it is not known
    force: np.ndarray | None = None

    @classmethod
    def of(cls, contact_set: ContactSet, *, tolerance: float, timestep: float) -> ContactState:
        """Return the contacts of now with the velocities of now."""
        gap = contact_set.gap
        closed = gap <= tolerance
        still = _STILL * tolerance / timestep
        velocity, gamma, noise, silent = _motion(contact_set, SILENT * still)
        quiet = (
            silent and contact_set.pattern.friction is None and bool((closed & (gap >= -CORRECTED * tolerance)).all())
        )
        return cls(contact_set, closed, still, velocity, gamma, noise, quiet)

    def moving(
        self,
        active: np.ndarray | None = None,
        contact_forces: ContactForces | None = None,
        force: np.ndarray | None = None,
    ) -> ContactState:
        """Return the same contacts with the velocities of now."""
        velocity, gamma, noise, _ = _motion(self.contact_set, SILENT * self.still)
        motion = velocity, gamma, noise, False
        if self._may_jump(active):  # and forces with them
            force = None
        return ContactState(self.contact_set, self.closed, self.still, *motion, active, contact_forces, force)

    def _may_jump(self, active: np.ndarray | None) -> bool:
        """Return whether points of contacts that are held may jump on common faces; one on a rim runs along it."""
        vague = self.pattern.vague if active is None else self.pattern.vague & active
        key = self.pattern.key[vague]
        return bool(np.count_nonzero(vague & ~self.pattern.rolling)) or len(np.unique(key)) < len(key)

    @property
    def configuration(self) -> Configuration:
        """The configuration that the contacts are of."""
        return self.contact_set.configuration

    @property
    def pattern(self) -> Pattern:
        """Properties of the contacts that follow from their geoms."""
        return self.contact_set.pattern

    @property
    def frames(self) -> Frames:
        """Frames of all geoms."""
        return self.contact_set.frames

    @property
    def gap(self) -> np.ndarray:
        """Gaps, m, (h,)."""
        return self.contact_set.gap

    @property
    def position(self) -> np.ndarray:
        """Contact points, m, (h, 3)."""
        return self.contacts.position

    @property
    def contacts(self) -> Contacts:
        """The contacts."""
        return self.contact_set.contacts

    @property
    def rounding(self) -> np.ndarray:
        """Contact velocities below which there is no telling motion from rounding, m/s, (h,)."""
        return np.maximum(self.noise, self.still)

    @property
    def collides(self) -> bool:
        """Whether a closed contact approaches."""
        return bool(np.count_nonzero(self.closed & (self.contact_velocity < -self.rounding)))


def _motion(contact_set: ContactSet, silent: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Return v, gamma, its noise, and whether gamma is all noise."""
    configuration = contact_set.configuration
    velocity = configuration.data.qvel.copy()
    gamma = contact_set.contact_velocity(velocity)
    noise = (_ROUNDING * configuration.kinetic_norm(velocity)) * contact_set.lengths
    return velocity, gamma, noise, not np.count_nonzero(np.abs(gamma) > silent)


class Phase(NamedTuple):
    """A smooth phase that has been tried."""

    start: ContactState  # where it began
    duration: float  # s
    tolerance: float  # gap up to which a contact is closed, m
    travel: Travel  # measures how far geoms have moved
    work: Work  # counts what the step has taken
    hold_all: bool = False  # whether every contact that is closed at its end is held there (time stepping)
    smooth: bool = False  # whether it is known that contacts between faces have moved smoothly, however far
    exact: bool = True  # whether friction is exact, or its convex relaxation


class PhaseEnd(NamedTuple):
    """The contacts at the end of a phase."""

    now: ContactState  # those contacts, and how they move now
    known: np.ndarray  # index of the same contact at the start, or -1, int (h,)
    sustained: np.ndarray  # which ones stay closed, bool (h,)

    @property
    def contact_set(self) -> ContactSet:
        """The contacts at the end of the phase."""
        return self.now.contact_set

    @property
    def gap(self) -> np.ndarray:
        """Their gaps, m, (h,)."""
        return self.now.gap


def stays(gap: np.ndarray, known: np.ndarray, phase: Phase) -> np.ndarray:
    """Return which contacts are sustained if they end the phase with these gaps, bool (h,)."""
    if phase.hold_all:
        return gap <= phase.tolerance
    start, tau = phase.start, phase.duration
    closed = start.closed
    if not np.count_nonzero(closed):
        return np.zeros(len(known), dtype=bool)
    velocity = start.contact_velocity[known]
    slow = velocity <= start.rounding[known]
    held = (known >= 0) & closed[known]
    if not np.count_nonzero(held & ~slow):
        return held
    closing = 2.0 * (start.gap[known] + velocity * tau - gap)  # times tau^2
    return held & (slow | ((velocity * tau) ** 2 <= 2.0 * closing * phase.tolerance))
