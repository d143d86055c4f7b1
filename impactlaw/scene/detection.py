"""Detection of near contacts by MuJoCo, with all data that depend on the geoms alone computed only once."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.scene.collide import collide, corrected_geoms
from impactlaw.scene.contacts import (
    Contacts,
    forget_rows,
    gap_gradients,
    geom_names,
    make_rows,
    some_short,
)
from impactlaw.scene.equality_constraints import bilateral_constraints, bilateral_rows, stiffness
from impactlaw.scene.joint_limits import LimitRows, Limits
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.options import BorrowedOptions
from impactlaw.scene.pairs import several_contacts
from impactlaw.scene.patterns import Pattern, Patterns
from impactlaw.scene.tolerances import GAP_TOLERANCE, PARALLEL, SKIN


class Found(NamedTuple):
    """The contacts and limits that are near at one configuration."""

    pattern: Pattern  # properties of the geoms
    contacts: Contacts  # contacts and limits
    jacobian: np.ndarray  # their gap gradients, (h, nv)
    # gradients of equality constraints, (m, nv); None if there are no constraints, or no contact is near
    bilateral: np.ndarray | None
    stiffness: np.ndarray | None  # of these constraints, see `equality_constraints.stiffness`, (nv, nv)


class Distances(NamedTuple):
    """The shortest distances between pairs of geoms, as MuJoCo measures them."""

    geoms: np.ndarray  # ids, int (h, 2)
    distance: np.ndarray  # m, (h,)
    normal: np.ndarray  # from the first geom to the second, (h, 3)

    @classmethod
    def of(cls, data: mujoco.MjData) -> Distances | None:
        """Return the distances found by MuJoCo's last collision detection; None if it has found none."""
        if data.ncon == 0:
            return None
        contact = data.contact
        return cls(contact.geom, contact.dist, contact.frame[:, :3])

    @property
    def are_cut(self) -> bool:
        """Whether MuJoCo may have left out others: it stops at `mjMAXCONPAIR` of a pair, as on a fine height field."""
        most = mujoco.mjMAXCONPAIR
        return len(self.distance) >= most and bool((np.unique(self.geoms, axis=0, return_counts=True)[1] >= most).any())


class Detector:
    """The collision detection of one scene.

    Attributes:
        names: names of all geoms, as in contact labels.
        limits: the limits of joints and tendons.
        patterns: properties that depend on the geoms alone.
        options: a context to be entered (``with``) around every use of `find`.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        convex: bool = True,
        faces: bool = True,
        friction: bool = False,
        surfaces: Surfaces | None = None,
    ):
        self._model, self._surfaces = model, surfaces
        self.names = geom_names(model)
        self.limits = Limits(model)
        self._bilateral = bilateral_constraints(model)
        self._has_bilateral = bool(self._bilateral.any())
        self._has_limits, self._limits_of_rows = bool(self.limits), self.limits.of_rows
        has = {"limits": self._limits_of_rows, "bilateral": self._has_bilateral}
        self.options = BorrowedOptions(model, corrected_geoms(model), convex=convex, **has)
        alone = not (self._has_limits or self._has_bilateral)
        self.patterns = Patterns(model, self.names, self.limits.labels, faces=faces, friction=friction, alone=alone)
        nothing = np.zeros((0, 2), int)
        self.empty = self.patterns.of(nothing), Contacts((), nothing, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))

    def near(self, data: mujoco.MjData, within: float) -> Found:
        """Return the contacts with a gap of at most ``within``, m or rad.

        The pattern is that of all contacts detected, which may be more. Frames must be current; data.contact is
        replaced.
        """
        with self.options:
            found = self.look(data, 2.0 * within + SKIN)  # MuJoCo compares with "<"
        near = np.flatnonzero(found.contacts.gap <= within)
        return Found(found.pattern, found.contacts.select(near), found.jacobian[near], *found[3:])

    def look(self, data: mujoco.MjData, within: float) -> Found:
        """Return the contacts and limits with a gap below ``within``, m or rad, and perhaps some more."""
        pattern, contacts = self.find(data, within)
        limits = self._limits_near(data, within) if self._has_limits else None
        if not len(contacts.gap) and limits is None and not self._limits_of_rows:
            return Found(pattern, contacts, np.zeros((0, self._model.nv)), None, None)
        J = bilateral = stiff = None
        if len(contacts.gap) or self._limits_of_rows or self._has_bilateral:
            J = make_rows(self._model, data)
            bilateral = bilateral_rows(self._model, data, self._bilateral) if data.ne else None
            stiff = None if bilateral is None else stiffness(self._model, data, self._bilateral)
            if data.nl:
                limits = self.limits.read(data)
            forget_rows(data)
        if pattern.several or J is None or some_short(J):
            J = gap_gradients(self._model, data, contacts)
        elif pattern.order is not None:
            J = J[pattern.order]
        if limits is None:
            return Found(pattern, contacts, J, bilateral, stiff)
        pattern = self.patterns.with_limits(pattern, limits.code)
        position, normal = self.limits.places(data, limits.code)
        if contacts:
            position, normal = np.vstack([contacts.position, position]), np.vstack([contacts.normal, normal])
        contacts = Contacts(pattern.labels, pattern.geoms, np.append(contacts.gap, limits.gap), position, normal)
        J = np.vstack([J, limits.jacobian]) if len(J) else limits.jacobian
        return Found(pattern, contacts, J, bilateral, stiff)

    def _limits_near(self, data: mujoco.MjData, within: float) -> LimitRows | None:
        """Return the limits found from joint positions; None if none is near, or if constraint rows are needed."""
        if self._limits_of_rows or not self.options.limited:
            return None
        return self.limits.near(data, within)

    def find(self, data: mujoco.MjData, within: float) -> tuple[Pattern, Contacts]:
        """Return all contacts between geoms with a gap below ``within``, m, and perhaps some more; see `near`."""
        self._collide(data, within)
        if data.ncon == 0:
            return self.empty
        pattern, contacts = self._read(data)
        if pattern.several and self.options.several:
            nearest = contacts.select(several_contacts(self._model, pattern.geoms))
            self._collide(data, within, several=True)
            pattern, several = self._read(data)
            contacts = _complete(several, nearest)
            if len(contacts) > len(several):
                pattern = self.patterns.of(contacts.geoms.astype(np.int32))
        if pattern.skin is not None:
            contacts = replace(contacts, gap=contacts.gap - pattern.skin)
        return pattern, contacts

    def refresh(self, data: mujoco.MjData, within: float, pattern: Pattern) -> None:
        """Fill data.contact as `find` does for a known pattern, without reading the contacts."""
        self._collide(data, within, several=pattern.several and self.options.several)

    def distances(self, data: mujoco.MjData, within: float) -> Distances | None:
        """Return the distances between geoms that are below ``within``, m, and perhaps more; None if there are none.

        Replaces data.contact.
        """
        self._collide(data, within)
        return Distances.of(data)

    def is_at_limit(self, data: mujoco.MjData, within: float) -> bool:
        """Return whether a limit is near; if limits are read from constraint rows, whether any contact or limit is."""
        if self._limits_of_rows:
            return bool(self.look(data, within).pattern)
        return self._has_limits and self._limits_near(data, within) is not None

    def are_closed(self, data: mujoco.MjData, within: float, pattern: Pattern, gaps: tuple[float, float]) -> bool:
        """Return whether the contacts with gaps below ``within`` are exactly those of a plain pattern, and closed.

        Args:
            data: the state; frames must be current.
            within: see `find`.
            pattern: the contacts to compare with; must be plain.
            gaps: the smallest and the largest gap that count as closed, m.
        """
        self._collide(data, within)
        contact = data.contact
        if contact.geom.tobytes() != pattern.found:
            return False
        distances = contact.dist.tolist()
        return gaps[0] <= min(distances) and max(distances) <= gaps[1]

    def _collide(self, data: mujoco.MjData, within: float, *, several: bool = False) -> None:
        self.options.look(within + SKIN, several=several)
        collide(self._model, data, self.options.corrected, stands=self.options.stands, surfaces=self._surfaces)

    def _read(self, data: mujoco.MjData) -> tuple[Pattern, Contacts]:
        found = data.contact
        pattern = self.patterns.of(found.geom)
        gap, position, normal = found.dist.copy(), found.pos.copy(), found.frame[:, :3].copy()
        order = pattern.order
        if order is not None:
            gap, position, normal = gap[order], position[order], normal[order] * pattern.sign
        return pattern, Contacts(pattern.labels, pattern.geoms, gap, position, normal)


def _complete(several: Contacts, nearest: Contacts) -> Contacts:
    """Give contacts between faces the direction of the shortest distance, and add the nearest contact if it is missing.

    When MuJoCo looks for several contacts, it treats faces within some degrees as parallel and uses the normal of one
    face for all contacts. The contacts that it chooses need not include the nearest one.
    """
    gap, normal = several.gap.copy(), several.normal.copy()
    key = np.concatenate([several.geoms, nearest.geoms]) @ (1 << 32, 1)
    pairs, which = np.unique(key, return_inverse=True)
    of_several, of_nearest = np.split(which, [len(several)])
    number = np.full(len(pairs), -1)
    number[of_nearest] = np.arange(len(nearest))
    found = number[of_several]
    direction = nearest.normal[found]
    cosine = (normal * direction).sum(axis=1)
    parallel = (found >= 0) & (cosine > PARALLEL)
    gap[parallel] /= cosine[parallel]
    normal[parallel] = direction[parallel]
    smallest = np.full(len(pairs), np.inf)
    np.minimum.at(smallest, of_several, gap)
    kept = smallest[of_nearest] > nearest.gap + GAP_TOLERANCE
    several, missing = replace(several, gap=gap, normal=normal), nearest.select(kept)
    if len(missing) == 0:
        return several
    both = several.followed_by(missing)
    return both.select(np.lexsort((both.geoms[:, 1], both.geoms[:, 0])))
