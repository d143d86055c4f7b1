"""The options of a stepper: which values they have, and which mean nothing to a way to step."""

from __future__ import annotations

from typing import Literal, NamedTuple

from impactlaw.errors import SceneError, UnknownNameError
from impactlaw.solvers import SOLVERS
from impactlaw.stepping.compatibility import FRICTION, check_count, check_length, check_speed

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
"""What an error calls each option, and its values."""

_UNUSED = {
    "soft": ("scheme", "overlap", "on_unsolved", "gap_tolerance"),
    "event-driven": ("rest_speed", "compiled"),
    "time-stepping": ("on_unsolved", "gap_tolerance", "max_events", "solver"),
}
"""Options that a way to step has no use for."""


class Options(NamedTuple):
    """What a `Stepper` was told, None where it was not; see there."""

    contact_model: Literal["rigid", "soft"]
    scheme: Literal["event-driven", "time-stepping"] | None
    friction: Literal["coulomb", "convex", "ignore"] | None
    overlap: Literal["refuse", "push-out"] | None
    on_inadmissible: Literal["raise", "project", "allow"] | None
    on_unsolved: Literal["time-stepping", "raise"] | None
    gap_tolerance: float | None
    rest_speed: float | None
    max_events: int | None
    solver: str | None
    compiled: Literal["auto", "never"] | None

    @property
    def way(self) -> Literal["soft", "event-driven", "time-stepping"]:
        """The way to step."""
        return "soft" if self.contact_model == "soft" else self.scheme or "event-driven"

    def check(self) -> None:
        """Refuse values that there are not, and options that would change nothing.

        Raises:
            UnknownNameError: an option has no such value; names those that there are.
            SceneError: an option is given that is for another way to step.
            OptionError: rest_speed is not a speed, gap_tolerance no length, or max_events no count.
        """
        for name, (kind, known) in _KNOWN.items():
            if getattr(self, name) not in known:
                raise UnknownNameError(kind, getattr(self, name), [value for value in known if value])
        for name in _UNUSED[self.way]:
            if getattr(self, name) is not None:
                raise SceneError(f"{name} means nothing to {self.way} steps; leave it out")
        if self.way == "time-stepping" and self.overlap == "refuse":
            raise SceneError('time stepping opens what overlaps, over time; leave overlap="refuse" out')
        check_length("gap_tolerance", self.gap_tolerance)
        check_speed("rest_speed", self.rest_speed)
        check_count("max_events", self.max_events)
