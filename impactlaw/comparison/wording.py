"""What steppers and laws advise, in the words of `impactlaw compare`: its options, and its names of laws."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from impactlaw.errors import ImpactLawError

_WORDS = (
    (r'overlap="push-out", or scheme="time-stepping", do it', "--scheme time-stepping do it"),
    (r'scheme="time-stepping",? or contact_model="soft"', "--scheme time-stepping"),
    (r'use contact_model="soft", or leave out', "leave out"),
    (r', or use contact_model="soft"', ""),
    (r'use contact_model="soft"', "compare cannot take it"),
    (r"pass gap_tolerance=\S+, or at least \S+", "use --scheme time-stepping"),
    (r', or on_inadmissible="project" or "allow"', ""),
    (r"a smaller timestep, a larger max_events, or", "a smaller --timestep or"),
    (r"friction='convex' contradicts it; leave it out", "--friction convex contradicts it; leave it out"),
    (r"take Coulomb\(Poisson\(e\)\)", "take --laws poisson"),
    (r"take Coulomb around Newton or Poisson", "take --laws newton or --laws poisson"),
    (r'\b(scheme|friction)="([a-z-]+)"', r"--\1 \2"),
)
"""Patterns of what a stepper, or a law, may be told in Python, and what stands for them; the first ones first."""


def in_options(text: str) -> str:
    """Return what a stepper or a law says, with what the command has in place of what Python has."""
    for pattern, words in _WORDS:
        text = re.sub(pattern, words, text)
    return text


@contextmanager
def refusals_in_options() -> Iterator[None]:
    """Let errors of this package say what to do by `in_options`."""
    try:
        yield
    except ImpactLawError as error:
        error.args = (in_options(str(error)),)
        raise
