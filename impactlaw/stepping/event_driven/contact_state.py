"""Contacts at one time and their motion; the smooth phase that starts there; which contacts stay closed in it."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.mechanics.kinetic_metric import KineticMetric
from impactlaw.scene.contacts import Contacts
from impactlaw.scene.patterns import Pattern
from impactlaw.solvers.problem import row_lengths
from impactlaw.stepping.collisions import Closed
from impactlaw.stepping.event_driven.configuration import Configuration
from impactlaw.stepping.event_driven.contact_set import ContactSet, Rows
from impactlaw.stepping.event_driven.location.travel import Frames, Travel
from impactlaw.stepping.work import Work

CORRECTED = 1e-2
"""Part of the gap tolerance to which positions are corrected."""

SILENT = 0.1
"""Contact velocities below this part of `ContactState.still` count as rounding, even if rounding itself is smaller."""

_ROUNDING = 1e-13  # rounding of a contact velocity in the kinetic metric, relative to the velocity of the whole scene
_CLEAR = 1e-4  # contact velocity relative to that of the scene that is no rounding whatever M is (cond M < 1e18)
_ALONG = 0.9  # cosine of the angle to the axis of a cylinder up to which two contacts lie along it
_CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_STILL = 1e-3  # part of the gap tolerance that a contact must cross in a timestep to count as moving


class ContactForces(NamedTuple):
    """The forces that held contacts with friction in a phase."""

    rows: Rows  # rows of the contacts, at the end of the phase
    force: np.ndarray  # normal force, then friction divided by its coefficients, N or N m, (h, 6)


class ContactState(NamedTuple):
    """Contacts at one time, and their motion."""

    contact_set: ContactSet  # the detected contacts, open ones included
    pattern: Pattern  # properties of the contacts that follow from their geoms
    gap: np.ndarray  # gaps, m, (h,)
    closed: np.ndarray  # contacts with a gap of at most the tolerance, bool (h,)
    still: float  # largest contact velocity that counts as still: it crosses almost no distance in a timestep, m/s
    velocity: np.ndarray  # qvel, (nv,)
    contact_velocity: np.ndarray  # ``gamma``, m/s, (h,)
    rounding: np.ndarray  # contact velocities below which motion cannot be distinguished from rounding, m/s, (h,)
    active: np.ndarray | None = None  # contacts that the last phase had to hold, bool (h,); None if there was no phase
    # forces with which the phase held them if there is friction; None if there were none
    contact_forces: ContactForces | None = None
    # generalized force of these contacts, N or N m, (nv,), torques of `BodyAxes` along the axes of the world; None if
    # it is not known
    force: np.ndarray | None = None

    @classmethod
    def of(cls, contact_set: ContactSet, *, tolerance: float, timestep: float) -> ContactState:
        """Return the current contacts with the current velocities."""
        gap = contact_set.gap
        closed = gap <= tolerance
        still = _STILL * tolerance / timestep
        return cls(contact_set, contact_set.pattern, gap, closed, still, *_motion(contact_set, closed, still))

    def moving(
        self,
        active: np.ndarray | None = None,
        contact_forces: ContactForces | None = None,
        force: np.ndarray | None = None,
    ) -> ContactState:
        """Return the same contacts with the current velocities."""
        motion = _motion(self.contact_set, self.closed, self.still)
        if force is not None and active is not None and not self._lasts(active):
            force = None
        return ContactState(*self[:5], *motion, active, contact_forces, force)

    def _lasts(self, active: np.ndarray) -> bool:
        """Return whether the next phase may feel the force of these contacts: they are closed, and stay where they are.

        The force of one that has opened would throw the bodies, since that contact is not held to the end of the phase.
        """
        return not np.count_nonzero(active & ~self.closed) and not self._may_jump(active)

    def _may_jump(self, active: np.ndarray) -> bool:
        """Return whether points of held contacts may jump: on height fields, and on the flat end of a cylinder.

        A single point on a rim runs along it instead, as do both ends of the line on which a cylinder lies. Corners of
        meshes move with them.
        """
        vague = self.pattern.vague & active
        if not np.count_nonzero(vague):
            return False
        if np.count_nonzero(vague & ~self.pattern.rolling):
            return True
        cylinders = self.configuration.model.geom_type[self.contacts.geoms] == _CYLINDER
        chosen = np.flatnonzero(vague & cylinders.any(axis=1))
        _, first, count = np.unique(self.pattern.key[chosen], return_index=True, return_counts=True)
        one = chosen[first[count == 2]]
        return count.max(initial=0) > 2 or not self._are_lines(one, chosen[first[count == 2] + 1])

    def _are_lines(self, one: np.ndarray, other: np.ndarray) -> bool:
        """Return whether contacts, (k,), and others of the same geoms, (k,), lie along the axis of a cylinder each."""
        geoms, line = self.contacts.geoms[one], self.contacts.position[other] - self.contacts.position[one]
        axis = self.frames.rotation[geoms].reshape(-1, 2, 3, 3)[..., 2]
        along = np.abs(np.einsum("kgi,ki->kg", axis, line)) > _ALONG * np.linalg.norm(line, axis=1)[:, None]
        return bool(np.any(along & (self.configuration.model.geom_type[geoms] == _CYLINDER), axis=1).all())

    @property
    def configuration(self) -> Configuration:
        """The configuration of the contacts."""
        return self.contact_set.configuration

    @property
    def frames(self) -> Frames:
        """Frames of all geoms."""
        return self.contact_set.frames

    @property
    def contacts(self) -> Contacts:
        """The contacts."""
        return self.contact_set.contacts

    def approaches(self, held: np.ndarray) -> bool:
        """Return whether one of these closed contacts, bool (h,), approaches now, however slowly."""
        held = held & self.closed & (self.contact_velocity < 0.0)
        if not np.count_nonzero(held):
            return False
        return bool(np.count_nonzero(held & (self.contact_velocity < -_noise(self.contact_set, self.velocity))))

    def rounding_by(self, metric: KineticMetric, closed: Closed) -> np.ndarray:
        """Return `rounding` of the closed contacts, (k,), also where nothing here depends on it, given the metric."""
        noise = (_ROUNDING * metric.norm(self.velocity)) * row_lengths(metric.whiten_gradients(closed.jacobian))
        return np.maximum(noise, self.still)

    @property
    def collides(self) -> bool:
        """Whether a closed contact approaches."""
        return bool(np.count_nonzero(self.closed & (self.contact_velocity < -self.rounding)))


def _motion(contact_set: ContactSet, closed: np.ndarray, still: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return v, gamma and `ContactState.rounding`.

    Where each closed contact is still, or clearly moves, nothing depends on the noise, which takes a factor of M.
    """
    velocity = contact_set.configuration.data.qvel.copy()
    gamma = contact_set.contact_velocity(velocity)
    speeds, silent = list(map(abs, gamma.tolist())), SILENT * still
    moving = [i for i, shut in enumerate(closed.tolist()) if shut and speeds[i] > silent]
    if moving:
        clear, lengths = _CLEAR * mujoco.mju_norm(velocity), row_lengths(contact_set.jacobian).tolist()
        if min([speeds[i] - clear * lengths[i] for i in moving]) <= 0.0:
            return velocity, gamma, np.maximum(_noise(contact_set, velocity), still)
    return velocity, gamma, np.full(len(gamma), still)


def _noise(contact_set: ContactSet, velocity: np.ndarray) -> np.ndarray:
    """Return the size of the rounding errors of contact velocities at the current configuration, m/s, (h,)."""
    return (_ROUNDING * contact_set.configuration.kinetic_norm(velocity)) * contact_set.lengths


class Phase(NamedTuple):
    """A smooth phase that has been tried."""

    start: ContactState  # contacts at the start
    duration: float  # s
    tolerance: float  # gap up to which a contact is closed, m
    travel: Travel  # measures how far geoms have moved
    work: Work  # counts the work of the step
    hold_all: bool = False  # whether every contact that is closed at the end is held there (time stepping)
    smooth: bool = False  # whether contacts between faces are known to have moved smoothly, however far
    exact: bool = True  # whether friction is exact, or its convex relaxation


class PhaseEnd(NamedTuple):
    """The contacts at the end of a phase."""

    now: ContactState  # the contacts at the end, and their motion
    known: np.ndarray  # index of the same contact at the start, or -1, int (h,)
    sustained: np.ndarray  # contacts that stay closed, bool (h,)


def stays(gap: np.ndarray, known: np.ndarray, phase: Phase) -> np.ndarray:
    """Return which contacts are sustained if the phase ends with these gaps, bool (h,)."""
    if phase.hold_all:
        return gap <= phase.tolerance
    start, tau, held = phase.start, phase.duration, np.zeros(len(known), dtype=bool)
    shut = start.closed.tolist()
    if not (len(known) and True in shut):
        return held
    before = start.gap.tolist(), start.contact_velocity.tolist(), start.rounding.tolist()
    motion = list(zip(shut, *before, strict=True))
    for i, (index, end) in enumerate(zip(known.tolist(), gap.tolist(), strict=True)):
        closed, begun, velocity, rounding = motion[index]
        if index >= 0 and closed:
            travel = velocity * tau
            closing = 2.0 * (begun + travel - end)  # times tau^2
            held[i] = velocity <= rounding or travel * travel <= 2.0 * closing * phase.tolerance
    return held
