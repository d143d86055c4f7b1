"""Properties of contacts that depend only on their geoms, computed once for each sequence of contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from impactlaw.scene.contacts import contact_labels, sorted_geoms
from impactlaw.scene.friction_rows import FrictionPattern, learn_friction
from impactlaw.scene.joint_limits import NO_GEOM
from impactlaw.scene.pairs import one_contact, several_contacts, touching_distance, vague_contacts

_REMEMBERED = 256  # most patterns that are kept; a pile of bodies has many


@dataclass(frozen=True, eq=False)
class Pattern:
    """The properties of a sequence of contacts that depend only on the geoms, not on the configuration."""

    labels: tuple[str, ...]  # as in `Contacts`
    geoms: np.ndarray  # as in `Contacts`, int (h, 2)
    key: np.ndarray  # one number per pair of geoms, ascending, (h,)
    single: np.ndarray  # contacts of pairs that never have more than one contact, bool (h,)
    all_single: bool  # whether all contacts are single and no pair appears twice
    distinct: bool  # whether no two contacts are of the same pair
    vague: np.ndarray  # contacts that may be anywhere on common faces, bool (h,)
    rolling: np.ndarray  # vague contacts that move along one edge or face, not from piece to piece of a surface, (h,)
    skin: np.ndarray | None  # distance at which the geoms touch, m, (h,); None if 0 for all
    several: bool  # whether MuJoCo should look for several contacts of a pair
    order: np.ndarray | None  # indices that sort MuJoCo's contacts, int (h,); None if all is sorted, and sign is 1
    sign: np.ndarray  # -1 where MuJoCo has the higher geom id first, else 1, (h, 1)
    friction: FrictionPattern | None  # rows of friction; None if there are none, or friction is ignored
    found: bytes  # geom ids in MuJoCo's order, as bytes
    plain: bool  # each pair has one contact, whose distance in MuJoCo is the gap; no limits or equality constraints

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def geom_contacts(self) -> int:
        """Number of contacts between geoms: all but limits."""
        return len(self.found) // 8  # two int32 each


class Patterns:
    """The patterns of one scene."""

    def __init__(
        self,
        model: mujoco.MjModel,
        names: tuple[str, ...],
        limits: tuple[str, ...],
        *,
        faces: bool,
        friction: bool,
        alone: bool,
    ):
        self._model, self._names, self._limits = model, names, limits
        self._faces, self._friction, self._alone = faces, friction, alone
        self._known: dict[bytes, Pattern] = {}

    def forget(self) -> None:
        """Forget all patterns, so that they are read from the current model again."""
        self._known.clear()

    def of(self, geoms: np.ndarray) -> Pattern:
        """Return the pattern for geom ids in MuJoCo's order, int32 (h, 2)."""
        seen = geoms.tobytes()
        pattern = self._known.get(seen)
        return self._remember(seen, self._learn(geoms)) if pattern is None else pattern

    def with_limits(self, pattern: Pattern, code: np.ndarray) -> Pattern:
        """Return the pattern of contacts between geoms followed by limits; see `LimitRows`."""
        seen = pattern.geoms.tobytes() + b"limits" + code.tobytes()
        known = self._known.get(seen)
        if known is None:
            n, none = len(code), np.zeros(len(code), dtype=bool)
            known = replace(
                pattern,
                labels=pattern.labels + tuple(self._limits[i] for i in code),
                geoms=np.vstack([pattern.geoms, np.full((n, 2), NO_GEOM)]),
                key=np.concatenate([pattern.key, self._model.ngeom**2 + code]),
                single=np.concatenate([pattern.single, ~none]),
                vague=np.concatenate([pattern.vague, none]),
                rolling=np.concatenate([pattern.rolling, none]),
                skin=None if pattern.skin is None else np.concatenate([pattern.skin, np.zeros(n)]),
                friction=learn_friction(self._model, pattern.geoms, n) if self._friction else None,
            )
            self._remember(seen, known)
        return known

    def _remember(self, seen: bytes, pattern: Pattern) -> Pattern:
        if len(self._known) >= _REMEMBERED:
            self._known.clear()
        self._known[seen] = pattern
        return pattern

    def _learn(self, found: np.ndarray) -> Pattern:
        model = self._model
        geoms, order, swapped = sorted_geoms(found)
        key = geoms[:, 0] * model.ngeom + geoms[:, 1]
        single = one_contact(model, geoms)
        distinct = len(np.unique(key)) == len(key)
        all_single = bool(single.all()) and distinct
        skin, (vague, rolling) = touching_distance(model, geoms), vague_contacts(model, geoms)
        return Pattern(
            labels=contact_labels(geoms, self._names),
            geoms=geoms,
            key=key,
            single=single,
            all_single=all_single,
            distinct=distinct,
            vague=vague,
            rolling=rolling,
            skin=skin if skin.any() else None,
            several=self._faces and bool(several_contacts(model, geoms).any()),
            order=None if not swapped.any() and np.array_equal(order, np.arange(len(order))) else order,
            sign=np.where(swapped, -1.0, 1.0)[:, None],
            friction=learn_friction(model, geoms) if self._friction else None,
            found=found.tobytes(),
            plain=all_single and self._alone and not skin.any(),
        )
