"""Which contacts are near: MuJoCo's collision detection, with what depends on the geoms alone computed once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.contacts import (
    GAP_TOLERANCE,
    Contacts,
    collide,
    contact_labels,
    forget_rows,
    gap_gradients,
    geom_names,
    make_rows,
    row_velocities,
    sorted_geoms,
)
from impactlaw.equalities import bilateral_constraints, bilateral_rows
from impactlaw.geoms import (
    SKIN,
    one_contact,
    several_contacts,
    touching_distance,
    vague_contacts,
)
from impactlaw.limits import Limits, joined
from impactlaw.options import BorrowedOptions
from impactlaw.tangents import Grip, learn_grip

_PARALLEL = 0.99  # cosine of an angle within which MuJoCo takes two faces for parallel
_REMEMBERED = 256  # patterns; a pile has many


@dataclass(frozen=True, eq=False)
class Pattern:
    """What the geoms of a sequence of contacts say, whatever their configuration is.

    Attributes:
        labels: as in `Contacts`.
        geoms: as in `Contacts`, int (h, 2).
        key: one number per pair of geoms, ascending, (h,).
        single: which contacts are of pairs that never have more than one, bool (h,).
        all_single: whether all are.
        distinct: whether no two contacts are of the same pair.
        vague: which contacts may be anywhere in common faces, bool (h,).
        skin: distance at which the geoms touch, m, (h,); None if 0 for all.
        several: whether MuJoCo is to look for several contacts of a pair.
        index: 0, 1, .., (h,).
        ones: 1, 1, .., (h,).
        order: indices that bring MuJoCo's contacts into order; None if they are in it.
        sign: -1 where MuJoCo has the higher geom id first, else 1, (h, 1); None if 1 for all.
        grip: which rows of friction they have; None if they have none, or it is ignored.
        found: geom ids in MuJoCo's order, as bytes.
        plain: whether each pair has one contact, whose distance in MuJoCo is the gap, and nothing else has rows.
    """

    labels: tuple[str, ...]
    geoms: np.ndarray
    key: np.ndarray
    single: np.ndarray
    all_single: bool
    distinct: bool
    vague: np.ndarray
    skin: np.ndarray | None
    several: bool
    index: np.ndarray
    ones: np.ndarray
    order: np.ndarray | None
    sign: np.ndarray | None
    grip: Grip | None
    found: bytes
    plain: bool

    def __len__(self) -> int:
        return len(self.labels)


class Found(NamedTuple):
    """What is near at one configuration.

    Attributes:
        pattern: what the geoms say.
        contacts: contacts and limits.
        jacobian: their gap gradients, (h, nv).
        bilateral: gradients of equality constraints, (m, nv); None if there are none, or nothing is near.
    """

    pattern: Pattern
    contacts: Contacts
    jacobian: np.ndarray
    bilateral: np.ndarray | None


class Detector:
    """Finds the contacts of one scene.

    Args:
        model: the scene.
        convex: whether some pairs are measured by MuJoCo's general convex collider.
        faces: whether MuJoCo is to look for several contacts between faces where it can.
        friction: whether contacts are to have their friction.

    Attributes:
        names: of all geoms, as in contact labels.
        limits: of joints and tendons.
        options: to be entered (``with``) around every use of `find`.
    """

    def __init__(self, model: mujoco.MjModel, *, convex: bool = True, faces: bool = True, friction: bool = False):
        self._model = model
        self.names = geom_names(model)
        self.limits = Limits(model)
        self._bilateral = bilateral_constraints(model)
        self.options = BorrowedOptions(
            model, convex=convex, limits=bool(self.limits), bilateral=bool(self._bilateral.any())
        )
        self._faces = faces
        self._friction = friction
        self._patterns: dict[bytes, Pattern] = {}
        nothing = np.zeros((0, 2), int)
        self.empty = self._pattern(nothing), Contacts((), nothing, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))

    def near(self, data: mujoco.MjData, within: float) -> Found:
        """Return the contacts with a gap of at most ``within``, m or rad; the pattern is that of more.

        Frames must be current; replaces data.contact.

        Raises:
            SceneError: a flex is in contact, or there are more contacts than MuJoCo reports.
        """
        with self.options:
            found = self.look(data, 2.0 * within + SKIN)  # MuJoCo compares with "<"
        near = np.flatnonzero(found.contacts.gap <= within)
        return Found(found.pattern, found.contacts.select(near), found.jacobian[near], found.bilateral)

    def look(self, data: mujoco.MjData, within: float) -> Found:
        """Return contacts and limits with a gap below ``within``, m or rad, and perhaps more."""
        pattern, contacts = self.find(data, within)
        if not pattern and not self.limits:
            return Found(pattern, contacts, np.zeros((0, self._model.nv)), None)
        J = make_rows(self._model, data)
        bilateral = bilateral_rows(self._model, data, self._bilateral) if data.ne else None
        limits = self.limits.read(data) if data.nl else None
        forget_rows(data)
        if pattern.several or J is None:
            J = gap_gradients(self._model, data, contacts)
        elif pattern.order is not None:
            J = J[pattern.order]
        if limits is None:
            return Found(pattern, contacts, J, bilateral)
        contacts = joined(contacts, self.limits.contacts(data, limits))
        pattern = self._with_limits(pattern, contacts, limits.code)
        return Found(pattern, contacts, np.vstack([J, limits.jacobian]), bilateral)

    def find(self, data: mujoco.MjData, within: float) -> tuple[Pattern, Contacts]:
        """Return all contacts of geoms with a gap below ``within``, m, and perhaps more; see `near`."""
        self.options.look(within + SKIN)
        collide(self._model, data)
        if data.ncon == 0:
            return self.empty
        pattern, contacts = self._read(data)
        if pattern.several and self.options.several:
            nearest = contacts.select(several_contacts(self._model, pattern.geoms))
            self.options.look_for_several()
            collide(self._model, data)
            pattern, several = self._read(data)
            contacts = _complete(several, nearest)
            if len(contacts) > len(several):
                pattern = self._pattern(contacts.geoms.astype(np.int32))
        if pattern.skin is not None:
            contacts = replace(contacts, gap=contacts.gap - pattern.skin)
        return pattern, contacts

    def refresh(self, data: mujoco.MjData, within: float, pattern: Pattern) -> None:
        """Leave in data.contact what `find` leaves there where the pattern is known, and read nothing."""
        self.options.look(within + SKIN)
        if pattern.several and self.options.several:
            self.options.look_for_several()
        collide(self._model, data)

    def is_quiet(
        self, data: mujoco.MjData, within: float, pattern: Pattern, gaps: tuple[float, float], speed: float
    ) -> bool:
        """Return whether the contacts within a gap, m, are those of a plain pattern, with small gaps and velocities.

        Args:
            data: frames must be current.
            within: see `find`.
            pattern: which contacts; must be plain.
            gaps: the smallest and the largest that are small, m.
            speed: the largest contact velocity that is small, m/s.
        """
        self.options.look(within + SKIN)
        collide(self._model, data)
        if data.ncon != len(pattern):
            return False
        contact = data.contact
        distances = contact.dist.tolist()
        if min(distances) < gaps[0] or max(distances) > gaps[1] or contact.geom.tobytes() != pattern.found:
            return False
        mujoco.mj_makeConstraint(self._model, data)
        velocities = row_velocities(self._model, data, data.qvel).tolist()
        forget_rows(data)
        return len(velocities) == len(pattern) and max(map(abs, velocities)) <= speed

    def _read(self, data: mujoco.MjData) -> tuple[Pattern, Contacts]:
        found = data.contact
        pattern = self._pattern(found.geom)
        order = pattern.order
        if order is None:
            gap, position, normal = found.dist.copy(), found.pos.copy(), found.frame[:, :3].copy()
        else:
            gap, position, normal = found.dist[order], found.pos[order], found.frame[order, :3]
        if pattern.sign is not None:
            normal *= pattern.sign
        return pattern, Contacts(pattern.labels, pattern.geoms, gap, position, normal)

    def _pattern(self, geoms: np.ndarray) -> Pattern:
        """Return what geom ids in MuJoCo's order say."""
        seen = geoms.tobytes()
        pattern = self._patterns.get(seen)
        if pattern is None:
            if len(self._patterns) >= _REMEMBERED:
                self._patterns.clear()
            pattern = self._patterns[seen] = self._learn(geoms)
        return pattern

    def _with_limits(self, pattern: Pattern, contacts: Contacts, code: np.ndarray) -> Pattern:
        """Return the pattern of contacts between geoms followed by limits."""
        seen = pattern.geoms.tobytes() + b"limits" + code.tobytes()
        known = self._patterns.get(seen)
        if known is None:
            n, none = len(code), np.zeros(len(code), dtype=bool)
            known = self._patterns[seen] = replace(
                pattern,
                labels=contacts.labels,
                geoms=contacts.geoms,
                key=np.concatenate([pattern.key, self._model.ngeom**2 + code]),
                single=np.concatenate([pattern.single, ~none]),
                vague=np.concatenate([pattern.vague, none]),
                skin=None if pattern.skin is None else np.concatenate([pattern.skin, np.zeros(n)]),
                index=np.arange(len(contacts)),
                ones=np.ones(len(contacts)),
            )
        return known

    def _learn(self, found: np.ndarray) -> Pattern:
        model = self._model
        geoms, order, swapped = sorted_geoms(found)
        key = geoms[:, 0] * model.ngeom + geoms[:, 1]
        single = one_contact(model, geoms)
        distinct = len(np.unique(key)) == len(key)
        skin = touching_distance(model, geoms)
        return Pattern(
            labels=contact_labels(geoms, self.names),
            geoms=geoms,
            key=key,
            single=single,
            all_single=bool(single.all()) and distinct,
            distinct=distinct,
            vague=vague_contacts(model, geoms),
            skin=skin if skin.any() else None,
            several=self._faces and bool(several_contacts(model, geoms).any()),
            index=np.arange(len(key)),
            ones=np.ones(len(key)),
            order=None if np.array_equal(order, np.arange(len(order))) else order,
            sign=np.where(swapped, -1.0, 1.0)[:, None] if swapped.any() else None,
            grip=learn_grip(model, geoms) if self._friction else None,
            found=found.tobytes(),
            plain=bool(single.all()) and distinct and not (self.limits or self._bilateral.any() or skin.any()),
        )


def _complete(several: Contacts, nearest: Contacts) -> Contacts:
    """Give contacts between faces the direction of the shortest distance, and add the nearest contact if it is missing.

    Where MuJoCo looks for several contacts, it takes faces within some degrees for parallel and the normal of one of
    them for that of the contacts; and the contacts it chooses need not include the nearest.
    """
    gap, normal = several.gap.copy(), several.normal.copy()
    kept = np.ones(len(nearest), dtype=bool)
    for i, pair in enumerate(nearest.geoms):
        same = np.flatnonzero((several.geoms == pair).all(axis=1))
        cosine = normal[same] @ nearest.normal[i]
        parallel = same[cosine > _PARALLEL]
        gap[parallel] /= cosine[cosine > _PARALLEL]
        normal[parallel] = nearest.normal[i]
        kept[i] = gap[same].min(initial=np.inf) > nearest.gap[i] + GAP_TOLERANCE
    several, missing = replace(several, gap=gap, normal=normal), nearest.select(kept)
    if len(missing) == 0:
        return several
    fields = ("geoms", "gap", "position", "normal")
    parts = [np.concatenate([getattr(several, name), getattr(missing, name)]) for name in fields]
    both = Contacts(several.labels + missing.labels, *parts)
    return both.select(np.lexsort((both.geoms[:, 1], both.geoms[:, 0])))
