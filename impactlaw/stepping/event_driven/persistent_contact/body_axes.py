"""Bodies of which MuJoCo has angular velocities and torques along axes that turn with the body.

These are bodies with a free joint, or with a ball joint and no hinges. A contact force that lasts from one phase to the
next one keeps its direction in the world, not in a body that spins.
"""

from __future__ import annotations

import mujoco
import numpy as np

_FREE, _BALL, _HINGE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "BALL", "HINGE"))
_NONE = np.zeros((0, 3, 3))


class BodyAxes:
    """The bodies with axes that turn with them; generalized forces and rows of J are arrays (..., nv)."""

    def __init__(self, model: mujoco.MjModel):
        kind, of = model.jnt_type, model.jnt_bodyid
        rotations = np.bincount(of[(kind == _BALL) | (kind == _HINGE)], minlength=model.nbody)
        joints = np.flatnonzero((kind == _FREE) | ((kind == _BALL) & (rotations[of] == 1)))
        self._bodies = of[joints]
        self._parents = model.body_parentid[self._bodies]
        first = model.jnt_dofadr[joints] + np.where(kind[joints] == _FREE, 3, 0)
        self._angular = first[:, None] + np.arange(3)

    def __len__(self) -> int:
        """Return the number of these bodies, n."""
        return len(self._bodies)

    def turns(self, data: mujoco.MjData) -> np.ndarray:
        """Return the rotation of each of these bodies, (n, 3, 3); frames must be current."""
        return data.xmat[self._bodies].reshape(-1, 3, 3) if len(self._bodies) else _NONE

    def to_world(self, rows: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Return rows with angular parts along the axes of the world."""
        return self._turned(rows, turns) if len(turns) else rows

    def to_bodies(self, rows: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Return rows with angular parts along the axes of the bodies, given those along the axes of the world."""
        return self._turned(rows, turns.swapaxes(1, 2)) if len(turns) else rows

    def apply(self, data: mujoco.MjData, force: np.ndarray) -> None:
        """Apply a force, (nv,), with torques along the axes of the world, beside those that are applied anyway.

        A torque on a body acts on its parent, too, in the opposite direction, so that other joints do not feel it.
        """
        if len(self._bodies):
            torque = force[self._angular]
            data.xfrc_applied[self._bodies, 3:] += torque
            np.subtract.at(data.xfrc_applied[:, 3:], self._parents, torque)
            force = force.copy()
            force[self._angular] = 0.0
        data.qfrc_applied += force

    def _turned(self, rows: np.ndarray, turns: np.ndarray) -> np.ndarray:
        result = rows.copy()
        result[..., self._angular] = (turns @ rows[..., self._angular, None])[..., 0]
        return result
