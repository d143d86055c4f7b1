"""The coefficients of a law for compiled code, found out contact by contact as they collide."""

from __future__ import annotations

import numpy as np

from impactlaw.laws.fremond import Reversal
from impactlaw.stepping.time_stepping.scheme import TimeStepping

_UNIT = np.array([-1.0])


class Coefficients:
    """Restitution by the keys of contacts, see `rows.Rows`; a key is looked up when it is first met.

    Args:
        scheme: whose law it is.

    Attributes:
        key: ascending, int64 (k,).
        value: e of each, (k,).
    """

    def __init__(self, scheme: TimeStepping):
        self._scheme, self._targets = scheme, scheme.problem.targets
        self.key, self.value = np.zeros(0, np.int64), np.zeros(0)

    def learn(self, key: int) -> None:
        """Ask the law for the restitution of a contact.

        Raises:
            RestitutionError: the law does not know it.
        """
        names, limits = self._scheme.problem.names, self._scheme.problem.limits
        if key >= 0:
            label = f"{names[key >> 32]}/{names[key & 0xFFFFFFFF]}"
        else:
            number, kind = divmod(-1 - key, 8)
            joint = kind == _LIMIT_JOINT
            label = limits.labels[2 * (number if joint else self._scheme.model.njnt + number)]
        e = float(self._targets.of_each((label,), _UNIT)[0])
        at = int(np.searchsorted(self.key, key))
        self.key, self.value = np.insert(self.key, at, key), np.insert(self.value, at, e)


_LIMIT_JOINT = 3  # mjtConstraint


def reason(scheme: TimeStepping) -> str | None:
    """Return why compiled code does not take a scheme; None if it does."""
    if scheme.follows_surfaces:
        return "mocap bodies that touch others move as surfaces"
    targets = scheme.problem.targets
    if targets.restitution is not None:
        return None
    if isinstance(targets.law, Reversal) and not scheme.model.neq:
        return None
    if not targets.alone:
        return f"{targets.law!r:.60} looks at all contacts of a collision at once"
    value = getattr(targets.law, "restitution", None)
    given = [*value.values(), getattr(targets.law, "default", None)] if isinstance(value, dict) else [value]
    if any(map(callable, given)):
        return "the restitution is a function of speed"
    if isinstance(value, tuple):
        return "the restitution is a sequence in the order of contacts"
    return None
