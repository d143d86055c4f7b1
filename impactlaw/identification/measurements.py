"""Measured collisions in the form that fits use: relative motion in the kinetic metric, over the speed before."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import count

import numpy as np
from numpy.typing import ArrayLike

from impactlaw.errors import MeasurementError
from impactlaw.laws.restitution.labels import canonical
from impactlaw.mechanics.arrays import real_array
from impactlaw.mechanics.collision import Collision

_RANK = 1e-10  # singular value of gradients, relative to the largest one, that is rounding
_STILL = 1e-12  # speed of relative motion at contacts, relative to that of all bodies, that counts as 0


class Measurements:
    """Collisions and the velocities observed after them.

    Errors are ``|P (v+ - v^)| / |P v-|`` in the kinetic metric. P is the projection onto the motion that contacts can
    see or change, the span of ``M^-1 J^T`` (of normal and sliding directions). The rest, such as the motion of the
    center of mass, is predicted by every law and would make errors look smaller.

    Raises:
        MeasurementError: there are no collisions, or not as many velocities; a velocity does not fit or is not finite;
            or a collision has no relative motion at its contacts.
    """

    def __init__(self, collisions: Sequence[Collision], post_velocities: Sequence[ArrayLike] | np.ndarray):
        for name, given in (("collisions", collisions), ("post_velocities", post_velocities)):
            if not np.iterable(given):
                raise MeasurementError(f"{name} must be a list with an entry for each collision, got {given!r:.60}")
        self.collisions = tuple(collisions)
        if not self.collisions:
            raise MeasurementError("there are no collisions to identify a law from")
        for c in self.collisions:
            if not isinstance(c, Collision):
                raise MeasurementError(f"collisions must be impactlaw.Collision, got {c!r:.60}")
        if len(post_velocities) != len(self.collisions):
            raise MeasurementError(f"{len(self)} collisions, but {len(post_velocities)} velocities after them")
        self.post_velocities = tuple(map(_velocity, post_velocities, self.collisions, count()))
        slow = np.flatnonzero(self.speeds <= _STILL * np.maximum([c.pre_speed for c in self.collisions], 1e-300))
        if len(slow):
            raise MeasurementError(
                f"collision {slow[0]} ({', '.join(self.collisions[slow[0]].labels) or 'no contacts'}) has no motion of "
                "its contacts before it; leave it out"
            )

    def __len__(self) -> int:
        return len(self.collisions)

    def select(self, indices: ArrayLike) -> Measurements:
        """Return the measurements with these indices."""
        chosen = [int(i) for i in np.asarray(indices)]
        return Measurements([self.collisions[i] for i in chosen], [self.post_velocities[i] for i in chosen])

    @cached_property
    def bases(self) -> tuple[np.ndarray, ...]:
        """Orthonormal rows that span the gradients of each collision, normal and sliding, (r, nv)."""
        whole = (np.linalg.svd(np.vstack([c.dense_gradients, c.whitened_friction]), False) for c in self.collisions)
        return tuple(V[s > _RANK * s.max(initial=0.0)] for _, s, V in whole)

    @cached_property
    def speeds(self) -> np.ndarray:
        """``|P v-|``, sqrt(J), (n,)."""
        return np.array(
            [np.linalg.norm(Q @ c.relative_velocity) for Q, c in zip(self.bases, self.collisions, strict=True)]
        )

    @cached_property
    def jumps(self) -> tuple[np.ndarray, ...]:
        """``R^T (v+ - v-)`` observed, (nv,) each."""
        pairs = zip(self.collisions, self.post_velocities, strict=True)
        return tuple(c.metric.whiten(v - c.pre_velocity) for c, v in pairs)

    def errors(self, velocities: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return ``P (v^ - v+) / |P v-|`` for predicted velocities v^, (r,) each."""
        found = zip(self.collisions, velocities, self.post_velocities, self.bases, self.speeds, strict=True)
        return [Q @ c.metric.whiten(v - after) / speed for c, v, after, Q, speed in found]

    @cached_property
    def contact_sets(self) -> dict[tuple[str, ...], list[int]]:
        """Indices of the collisions with each set of closed contacts, by the sorted canonical labels of the set."""
        return contact_sets([c.labels for c in self.collisions])

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Canonical labels of all contacts, in the order of first appearance."""
        return tuple(dict.fromkeys(canonical(label) for c in self.collisions for label in c.labels))


def contact_sets(labels: Iterable[Iterable[str]]) -> dict[tuple[str, ...], list[int]]:
    """Return the indices of the collisions with each set of closed contacts, given the labels of each collision."""
    sets: dict[tuple[str, ...], list[int]] = {}
    for i, own in enumerate(labels):
        sets.setdefault(tuple(sorted(map(canonical, own))), []).append(i)
    return sets


def of_contacts(contacts: str | Sequence[str], sets: Mapping[tuple[str, ...], list[int]]) -> list[int]:
    """Return the indices of the collisions of one set of closed contacts, named by its labels, or the one label.

    Raises:
        MeasurementError: no collision has exactly these contacts.
    """
    if not np.iterable(contacts):
        raise MeasurementError(f"contacts are the labels of a set of closed contacts, got {contacts!r:.60}")
    wanted = tuple(sorted(map(canonical, (contacts,) if isinstance(contacts, str) else contacts)))
    if not wanted:
        raise MeasurementError(
            "contacts is empty: there is nothing to fit; name the contacts of a set, or leave it out"
        )
    if wanted not in sets:
        known = "; ".join(" ".join(labels) for labels in sets)
        raise MeasurementError(f"no collision has exactly the contacts {', '.join(wanted)}; there are: {known}")
    return sets[wanted]


def rms(errors: Sequence[np.ndarray]) -> float:
    """Return the root of the mean of ``|error|^2``."""
    return float(np.sqrt(np.mean([error @ error for error in errors])))


def _velocity(value: ArrayLike, collision: Collision, index: int) -> np.ndarray:
    try:
        v = real_array(value)
    except (TypeError, ValueError):
        raise MeasurementError(f"the velocity after collision {index} is not an array of numbers") from None
    if v.shape != collision.pre_velocity.shape or not np.isfinite(v).all():
        raise MeasurementError(
            f"the velocity after collision {index} must be {len(collision.pre_velocity)} finite numbers, got {v!s:.100}"
        )
    return v
