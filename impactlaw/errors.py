"""The errors of impactlaw: each says what was wrong, where, and what to do about it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

import numpy as np

_MOST_LISTED = 40  # names in a message


class ImpactLawError(Exception):
    """Base of every error raised on purpose by this package."""


class InvalidCollisionError(ImpactLawError, ValueError):
    """Mass matrix, Jacobian or velocity are not a collision: wrong shape, not finite, not positive definite."""


class RestitutionError(ImpactLawError, ValueError):
    """A restitution coefficient or matrix is not one: negative, above one, not finite, or of the wrong size."""


class UnknownNameError(ImpactLawError, ValueError):
    """A law, solver, scene or contact name that does not exist; the message names the nearest known ones."""

    def __init__(self, kind: str, name: object, known: Iterable[str]):
        known = sorted(known)
        near = difflib.get_close_matches(str(name), known, n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(map(repr, near))}?" if near else f"known: {_listed(known)}"
        super().__init__(f"unknown {kind} {str(name)!r}; {hint}")


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_LISTED
    return ", ".join(names[:_MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


class UnsolvableLawError(ImpactLawError):
    """The law has no solution: no velocity reaches the wanted contact velocities of these contacts at once.

    Attributes:
        contacts: labels of the contacts that conflict.
        ray: a Farkas ray ``nu >= 0`` with ``J^T nu = 0`` and ``nu^T (gamma^h - gamma-) > 0``, shape (h,).
    """

    def __init__(self, contacts: Sequence[str], ray: np.ndarray):
        super().__init__(
            f"the law has no solution: contacts {', '.join(contacts)} ask for contact velocities that no motion "
            "has together; give all contacts one coefficient, change the matrix, or drop a redundant contact"
        )
        self.contacts = tuple(contacts)
        self.ray = ray


class SolverError(ImpactLawError):
    """A solver stopped without an answer that its certificate confirms."""


class UnfinishedStepError(ImpactLawError):
    """An event-driven step takes more work than it may, or contact cannot be held."""


class ManyCollisionsWarning(UserWarning):
    """A step had more collisions than are located one by one: the others are time stepped."""


class HeldJointsWarning(UserWarning):
    """Joints of a scene may be held still under rigid time stepping, where MuJoCo's own contacts give way."""


class UnreadSensorsWarning(UserWarning):
    """Sensors of a scene measure forces of contacts and limits, which event-driven steps do not leave in data."""


class InadmissibleImpactError(ImpactLawError):
    """The law's outcome leaves the set of possible right-velocities: it would create energy."""


class SceneError(ImpactLawError):
    """A file is not a scene, or the scene holds something that rigid stepping does not cover."""


class OverlapError(SceneError):
    """Geoms overlap at the start of a step by more than the gap tolerance, and may or can not be pushed out."""


class DivergenceError(ImpactLawError):
    """The simulation left the finite numbers."""


class RecordingError(ImpactLawError):
    """A recording cannot be written, or a file is not a recording of this package."""


class MeasurementError(ImpactLawError, ValueError):
    """Measured collisions, or a file of them, from which no law can be identified."""


class RenderError(ImpactLawError, RuntimeError):
    """Nothing to draw with: no OpenGL library, or no display for a window."""


class ActionError(ImpactLawError, ValueError):
    """An action of the wrong shape, or with numbers that are not finite."""


class WrapperError(ImpactLawError, TypeError):
    """A law cannot be put on an environment: it does not step MuJoCo in a way that is known, or has a law already."""


class OptionError(ImpactLawError, ValueError):
    """An option that does not exist, or with a value that it cannot have."""


class StudyError(ImpactLawError, ValueError):
    """A study that cannot be run as it is stated, or cells of it that have failed, or whose files cannot be read."""


class MissingExtraError(ImpactLawError, ImportError):
    """A package that only some need is not installed."""

    def __init__(self, what: str, package: str, extra: str):
        super().__init__(f"{what} needs {package}, which is not installed: pip install 'impactlaw[{extra}]'")


class SettledError(ImpactLawError, AttributeError):
    """Something that is settled when its owner is made was set later: it would have no effect."""


class UnsupportedError(ImpactLawError, NotImplementedError):
    """Something that another library's interface has, and that this object does not do."""


class CopyError(ImpactLawError, TypeError):
    """Something that cannot be copied or pickled."""


class UncompiledWarning(UserWarning):
    """Steps are taken in Python, though compiled ones were asked for."""


class WorldsFailedError(ImpactLawError):
    """Some worlds have failed; they are as they were before the call, and the others have made their steps.

    Attributes:
        worlds: numbers of those that have failed, int (k,).
        diverged: whether all of them have left the finite numbers: in one world that is a `DivergenceError`.
    """

    def __init__(self, worlds: Sequence[int], why: str, *, diverged: bool = False):
        self.worlds, self.diverged = worlds, diverged
        some = ", ".join(map(str, worlds[:5])) + (" .." if len(worlds) > 5 else "")
        super().__init__(f"{len(worlds)} world{'s have' if len(worlds) > 1 else ' has'} failed ({some}): {why}")
