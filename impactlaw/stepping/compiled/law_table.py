"""The coefficients of a law for compiled code, looked up contact by contact as they collide."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.laws import Newton
from impactlaw.scene.joint_limits import Limits
from impactlaw.stepping.law_targets import LawTargets

_UNIT = np.array([-1.0])
_LIMIT_JOINT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_LIMITS_OF_JOINTS = _LIMIT_JOINT, _LIMIT_JOINT + 2


class Coefficients:
    """Restitution by the keys of contacts; a key is looked up when it first occurs.

    The key of a contact is the lower geom number times ``2^32``, plus the higher one. The key of a limit of a joint or
    tendon is ``-1 - (8 number + kind)`` with MuJoCo's kind of constraint; 2 is added to the kind for the lower limit if
    the limit has a single degree of freedom.

    Attributes:
        key: the keys, ascending, int64 (k,).
        value: e for each key, (k,).
    """

    def __init__(self, targets: LawTargets, names: tuple[str, ...], limits: Limits, joints: int):
        self._targets, self._names, self._limits, self._joints = targets, names, limits, joints
        self.key, self.value = np.zeros(0, np.int64), np.zeros(0)

    def learn(self, key: int) -> None:
        """Look up the restitution of a contact in the law."""
        if key >= 0:
            label = f"{self._names[key >> 32]}/{self._names[key & 0xFFFFFFFF]}"
        else:
            number, kind = divmod(-1 - key, 8)
            label = self._limits.labels[2 * (number if kind in _LIMITS_OF_JOINTS else self._joints + number)]
        e = float(self._targets.of_each((label,), _UNIT)[0])
        at = int(np.searchsorted(self.key, key))
        self.key, self.value = np.insert(self.key, at, key), np.insert(self.value, at, e)


def reason(targets: LawTargets) -> str | None:
    """Return why a law has no table of coefficients; None if it has one."""
    if targets.restitution is not None:
        return None
    if not targets.alone:
        return f"{targets.law!r:.60} looks at all contacts of a collision at once"
    kind = type(targets.law)
    if kind.target is not Newton.target or getattr(kind, "restitution_matrix", None) is not Newton.restitution_matrix:
        return f"the target of {targets.law!r:.60} may be another part of the velocity at another speed"
    value = getattr(targets.law, "restitution", None)
    given = [*value.values(), getattr(targets.law, "default", None)] if isinstance(value, dict) else [value]
    if any(map(callable, given)):
        return "the restitution is a function of speed"
    if isinstance(value, tuple):
        return "the restitution is a sequence in the order of contacts"
    return None
