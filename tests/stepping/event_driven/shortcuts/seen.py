"""Observe which shortcuts event-driven steps try, and take steps without shortcuts."""

from itertools import cycle
from typing import NamedTuple

import mujoco

from impactlaw.scene.detection import Detector
from impactlaw.stepping.event_driven.shortcuts import Apart, Rest, Shortcut, Together
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases

_IRRELEVANT = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # matters only for numbers that are not finite


class Tried(NamedTuple):
    """A shortcut that a step has tried, and whether it held."""

    shortcut: Shortcut
    phases: SmoothPhases
    held: bool


def tried(monkeypatch) -> list[Tried]:
    """Return a list that gets an entry whenever a step tries a shortcut."""
    seen = []
    for kind in (Apart, Together, Rest):

        def watched(self, phases, lasts=kind.lasts):
            following = lasts(self, phases)
            seen.append(Tried(self, phases, following is not None))
            return following

        monkeypatch.setattr(kind, "lasts", watched)
    return seen


def looks(monkeypatch) -> list[int]:
    """Return a list that gets an entry whenever contacts are read."""
    seen, look = [], Detector.look
    monkeypatch.setattr(Detector, "look", lambda *args: seen.append(1) or look(*args))
    return seen


def forgetful(stepper):
    """Return a step that takes no shortcut and detects contacts first, because a flag of the options has changed."""
    options, flags = stepper.model.opt, cycle((0, _IRRELEVANT))

    def step(data):
        own = options.disableflags
        options.disableflags = own ^ next(flags)
        stepper.step(data)
        options.disableflags = own

    return step
