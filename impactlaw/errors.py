"""The errors and warnings of impactlaw; their messages say what was wrong, where, and what to do about it."""

from __future__ import annotations

import difflib
import importlib.util
import inspect
import warnings
from collections.abc import Iterable, Sequence

import numpy as np

_MOST_LISTED = 40  # most names in a message


class ImpactLawError(Exception):
    """Base of all errors that this package raises on purpose."""


class InvalidCollisionError(ImpactLawError, ValueError):
    """Invalid data for a collision, such as a wrong shape, entries that are not finite, or M not positive definite."""


class RestitutionError(ImpactLawError, ValueError):
    """An invalid restitution coefficient or matrix: negative, above one, not finite, or of the wrong size."""


class UnknownNameError(ImpactLawError, ValueError):
    """The name of a law, solver, scene or contact does not exist; the message suggests the nearest known names."""

    def __init__(self, kind: str, name: object, known: Iterable[str]):
        known = sorted(known)
        near = difflib.get_close_matches(str(name), known, n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(map(repr, near))}?" if near else f"known: {_listed(known)}"
        super().__init__(f"unknown {kind} {str(name)!r}; {hint}")


def instead_of(value: object) -> str:
    """Return what to add to a message where MuJoCo's own object is wanted, "" if the value does not stand for one.

    Wrappers of dm_control, such as ``physics.model``, hold it, and a `mujoco.MjSpec` makes one.
    """
    if hasattr(value, "ptr"):
        return " (dm_control's wrapper: its attribute ptr is MuJoCo's own, as physics.model.ptr and physics.data.ptr)"
    return " (a specification: its method compile() returns the model)" if hasattr(value, "recompile") else ""


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_LISTED
    return ", ".join(names[:_MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


class UnsolvableLawError(ImpactLawError):
    """The law has no solution: no velocity reaches the target contact velocities of these contacts together.

    Attributes:
        contacts: labels of the contacts in conflict.
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
    """A solver stopped without an answer that passes its certificate."""


class UnfinishedStepError(ImpactLawError):
    """An event-driven step exceeds its budget of work, or persistent contact cannot be held."""


class ManyCollisionsWarning(UserWarning):
    """A step had more collisions than can be located one by one; the rest of it is time stepped."""


class HeldJointsWarning(UserWarning):
    """Rigid time stepping may lock joints of a scene that can move under MuJoCo's soft contacts."""


class UnreadSensorsWarning(UserWarning):
    """Sensors of a scene measure forces of contacts and limits, which event-driven steps do not write into data."""


class FlexContactsWarning(UserWarning):
    """Flexes of a scene can touch, and their contacts stay MuJoCo's: the law does not act on them."""


class InadmissibleImpactError(ImpactLawError):
    """The outcome of a law is outside the set of possible right-velocities, for example because it creates energy."""


class SceneError(ImpactLawError):
    """A file is not a scene, or the scene has a feature that rigid stepping does not support."""


class OverlapError(SceneError):
    """Geoms overlap at the start of a step by more than the gap tolerance, and must not or cannot be pushed out."""


class DivergenceError(ImpactLawError):
    """The state of the simulation is no longer finite."""


class RecordingError(ImpactLawError):
    """A recording cannot be written, or a file is not a recording of this package."""


class MeasurementError(ImpactLawError, ValueError):
    """A law cannot be identified from these measured collisions, or from this file of them."""


class RenderError(ImpactLawError, RuntimeError):
    """Rendering is not possible: there is no OpenGL library, or no display for a window."""


class ActionError(ImpactLawError, ValueError):
    """An action has the wrong shape, or numbers that are not finite."""


class WrapperError(ImpactLawError, TypeError):
    """A law cannot be applied to an environment that does not step MuJoCo in a known way, or that has a law already."""


class OptionError(ImpactLawError, ValueError):
    """An option does not exist, or has an invalid value."""


class StudyError(ImpactLawError, ValueError):
    """A study cannot be run as specified, or some of its cells have failed or have files that cannot be read."""


class MissingExtraError(ImpactLawError, ImportError):
    """A package that only some commands need is not installed."""

    def __init__(self, what: str, package: str, extra: str | None = None):
        install = package if extra is None else f"'impactlaw[{extra}]'"
        super().__init__(f"{what} needs {package}, which is not installed: pip install {install}")


def check_installed(package: str, what: str, extra: str | None = None) -> None:
    """Raise `MissingExtraError` if a package is not installed that `what` needs, perhaps only after much other work."""
    if importlib.util.find_spec(package.replace("-", "_")) is None:
        raise MissingExtraError(what, package, extra)


class UncompilableError(ImpactLawError, ImportError):
    """Compiled code cannot be used: numba cannot be imported, or MuJoCo's structures differ from its description."""


class SettledError(ImpactLawError, AttributeError):
    """An attribute that is fixed at construction was set later, which would have no effect."""


class UnsupportedError(ImpactLawError, NotImplementedError):
    """This object does not support a part of another library's interface."""


class CopyError(ImpactLawError, TypeError):
    """An object cannot be copied or pickled."""


class PassedOnWarning(UserWarning):
    """An option of a reset is passed on to the wrapped environment, but nearly has the name of an option of the law."""


class UncompiledWarning(UserWarning):
    """Steps run in Python, or ask a law in Python, although compiled steps were asked for."""


def warn_of_python(why: object, what: str = "steps are not compiled, but in Python") -> None:
    """Issue an `UncompiledWarning` at the line outside of this package from which it was called."""
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__", "").startswith("impactlaw."):
        level, frame = level + 1, frame.f_back
    warnings.warn(f"{what}: {why}", UncompiledWarning, stacklevel=level)


class WorldsFailedError(ImpactLawError):
    """Some worlds have failed; they are in their state before the call, and the others have made their steps.

    Attributes:
        worlds: numbers of the worlds that have failed, int (k,).
        diverged: whether the states of all these worlds are no longer finite, a `DivergenceError` for a single world.
    """

    def __init__(self, worlds: Sequence[int], why: str, *, diverged: bool = False):
        self.worlds, self.diverged = worlds, diverged
        some = ", ".join(map(str, worlds[:5])) + (" .." if len(worlds) > 5 else "")
        super().__init__(f"{len(worlds)} world{'s have' if len(worlds) > 1 else ' has'} failed ({some}): {why}")
