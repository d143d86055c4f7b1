"""Which contacts of a scene a law is for."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from impactlaw.errors import OptionError, UnknownNameError
from impactlaw.laws.restitution.labels import canonical, matches
from impactlaw.laws.restitution.on_contacts import Chosen
from impactlaw.scene.contacts import geom_names
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.pairs import geom_pairs


def select(model: mujoco.MjModel, contacts: str | Sequence[str] | None, limits: bool) -> Chosen | None:
    """Return the contacts that a law is for; None for all.

    Args:
        model: the scene.
        contacts: patterns of contacts between geoms, see `laws.restitution.labels`; None for all.
        limits: whether limits of joints and tendons are among them.

    Raises:
        OptionError: no patterns, or limits is neither True nor False.
        UnknownNameError: a pattern that no contact of the scene can match.
    """
    if not isinstance(limits, bool):
        raise OptionError(f"limits is True or False: whether limits of joints and tendons obey the law; got {limits!r}")
    of_limits = frozenset(map(canonical, Limits(model).names))
    if contacts is None:
        return None if limits else Chosen(of_limits, others=True)
    patterns = (contacts,) if isinstance(contacts, str) else tuple(contacts) if np.iterable(contacts) else ()
    if not patterns or not all(isinstance(pattern, str) for pattern in patterns):
        raise OptionError(
            f'contacts is a pattern such as "*foot*" or "*foot*/floor", or a list of these; got {contacts!r}'
        )
    names = geom_names(model)
    known = sorted({f"{names[a]}/{names[b]}" for a, b in geom_pairs(model).geoms})
    found: set[str] = set()
    for pattern in patterns:
        fitting = {canonical(label) for label in known if matches(pattern, label)}
        if not fitting:
            raise UnknownNameError("contact pattern", pattern, known)
        found |= fitting
    return Chosen(frozenset(found) | (of_limits if limits else frozenset()))
