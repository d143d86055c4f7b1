"""The options of a stepper: their values, which of them each way to step ignores, and which contacts a law is for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from impactlaw.errors import OptionError, SceneError, UnknownNameError
from impactlaw.laws.restitution.labels import canonical, matches
from impactlaw.laws.restitution.on_contacts import Chosen
from impactlaw.scene.contacts import contact_labels, geom_names
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.pairs import geom_pairs
from impactlaw.solvers import SOLVERS
from impactlaw.stepping.compatibility import FRICTION, check_count, check_gap_tolerance, check_rest_speed

_KNOWN = {
    "contact_model": ("contact_model", ("rigid", "soft")),
    "scheme": ("scheme", (None, "event-driven", "time-stepping")),
    "friction": ("friction option", (None, *FRICTION)),
    "overlap": ("overlap option", (None, "refuse", "push-out")),
    "on_inadmissible": ("on_inadmissible option", (None, "raise", "project", "allow")),
    "on_unsolved": ("on_unsolved option", (None, "time-stepping", "raise")),
    "solver": ("solver", (None, "auto", *SOLVERS)),
    "compiled": ("compiled option", (None, "auto", "never")),
}
"""The name of each option in error messages, and its possible values."""

_UNUSED = {
    "soft": ("scheme", "overlap", "on_unsolved", "gap_tolerance"),
    "event-driven": ("rest_speed", "compiled"),
    "time-stepping": ("on_unsolved", "gap_tolerance", "max_events", "solver"),
}
"""The options that do not apply to each way to step."""


class Options(NamedTuple):
    """The options that a `Stepper` was given, see there; None if an option was not given."""

    contact_model: Literal["rigid", "soft"]
    scheme: Literal["event-driven", "time-stepping"] | None = None
    friction: Literal["coulomb", "convex", "ignore"] | None = None
    overlap: Literal["refuse", "push-out"] | None = None
    on_inadmissible: Literal["raise", "project", "allow"] | None = None
    on_unsolved: Literal["time-stepping", "raise"] | None = None
    gap_tolerance: float | None = None
    rest_speed: float | None = None
    max_events: int | None = None
    solver: str | None = None
    compiled: Literal["auto", "never"] | None = None

    @property
    def way(self) -> Literal["soft", "event-driven", "time-stepping"]:
        """The way to step."""
        return "soft" if self.contact_model == "soft" else self.scheme or "event-driven"

    def check(self) -> None:
        """Refuse unknown values, and options that would have no effect.

        Raises:
            UnknownNameError: an option has no such value. The message names the possible values.
            SceneError: an option is given that is for another way to step.
            OptionError: rest_speed is not a speed, gap_tolerance not a length, or max_events not a count.
        """
        for name, (kind, known) in _KNOWN.items():
            if getattr(self, name) not in known:
                raise UnknownNameError(kind, getattr(self, name), [value for value in known if value])
        for name in _UNUSED[self.way]:
            if getattr(self, name) is not None:
                raise SceneError(f"{name} means nothing to {self.way} steps; leave it out")
        if self.way == "time-stepping" and self.overlap == "refuse":
            raise SceneError('time stepping opens what overlaps, over time; leave overlap="refuse" out')
        check_gap_tolerance(self.gap_tolerance)
        check_rest_speed(self.rest_speed)
        if self.max_events is not None:
            check_count("max_events", self.max_events)


def select(model: mujoco.MjModel, contacts: str | Sequence[str] | None, limits: bool) -> Chosen | None:
    """Return the contacts that the law is for; None for all.

    Args:
        model: the scene.
        contacts: patterns of contacts between geoms, see `laws.restitution.labels`; None for all.
        limits: whether the law is also for limits of joints and tendons.

    Raises:
        OptionError: contacts is not a pattern or a list of patterns, or limits is neither True nor False.
        UnknownNameError: no contact of the scene can match a pattern.
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
    known = sorted(set(contact_labels(geom_pairs(model).geoms, geom_names(model))))
    found: set[str] = set()
    for pattern in patterns:
        fitting = {canonical(label) for label in known if matches(pattern, label)}
        if not fitting:
            raise UnknownNameError("contact pattern", pattern, known)
        found |= fitting
    return Chosen(frozenset(found) | (of_limits if limits else frozenset()))
