"""Free bodies, of which MuJoCo has angular velocities and torques in a frame that turns with the body.

A contact force that lasts from one phase to the next one keeps its direction in the world, not in a body that spins.
"""

from __future__ import annotations

import mujoco
import numpy as np

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_NONE = np.zeros((0, 3, 3))


class FreeBodies:
    """The bodies with a free joint; generalized forces and rows of J are arrays (..., nv)."""

    def __init__(self, model: mujoco.MjModel):
        joints = np.flatnonzero(model.jnt_type == _FREE)
        self._bodies = model.jnt_bodyid[joints]
        self._angular = model.jnt_dofadr[joints][:, None] + np.arange(3, 6)

    def __len__(self) -> int:
        return len(self._bodies)

    def turns(self, data: mujoco.MjData) -> np.ndarray:
        """Return the rotation of each free body, (n, 3, 3); frames must be current."""
        return data.xmat[self._bodies].reshape(-1, 3, 3) if len(self._bodies) else _NONE

    def to_world(self, rows: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Return rows with angular parts along the axes of the world."""
        return self._turned(rows, turns) if len(turns) else rows

    def to_bodies(self, rows: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Return rows with angular parts along the axes of the bodies, given those along the axes of the world."""
        return self._turned(rows, turns.swapaxes(1, 2)) if len(turns) else rows

    def apply(self, data: mujoco.MjData, force: np.ndarray) -> None:
        """Apply a force, (nv,), with torques along the axes of the world, beside those that are applied anyway."""
        if len(self._bodies):
            data.xfrc_applied[self._bodies, 3:] += force[self._angular]
            force = force.copy()
            force[self._angular] = 0.0
        data.qfrc_applied += force

    def _turned(self, rows: np.ndarray, turns: np.ndarray) -> np.ndarray:
        result = rows.copy()
        result[..., self._angular] = (turns @ rows[..., self._angular, None])[..., 0]
        return result
