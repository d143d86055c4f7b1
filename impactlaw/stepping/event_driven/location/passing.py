"""Find geoms that would be behind each other, or deep in each other, after half a timestep without a look."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from impactlaw.scene.pairs import thickness

_DEEP = 0.5  # part of the thickness of two geoms that they may overlap by
_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)


class Passing:
    """Measures how far geoms that can meet move past each other at their current velocity."""

    def __init__(self, model: mujoco.MjModel, geoms: np.ndarray):
        thin = thickness(model)
        size = np.where(np.isfinite(thin), thin, 0.0)[geoms].sum(axis=1)
        self._model, self._pairs, self._thickness = model, geoms[size > 0.0], size[size > 0.0]
        self._used = np.unique(self._pairs)
        self._lever = np.where(np.isfinite(thin), np.maximum(model.geom_rbound - thin, 0.0), 0.0)

    def parts(self, data: mujoco.MjData, duration: float, *, drift: float) -> int:
        """Return the number of parts of a duration whose halves do not go too deep; frames become current."""
        model, size = self._model, self._thickness
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        velocity, turning, both = np.zeros((model.ngeom, 3)), np.zeros(model.ngeom), np.empty(6)
        for geom in self._used.tolist():
            mujoco.mj_objectVelocity(model, data, _GEOM, geom, both, 0)
            velocity[geom], turning[geom] = both[3:], self._lever[geom] * np.linalg.norm(both[:3])
        fastest = (np.linalg.norm(velocity, axis=1) + turning).max(initial=0.0)
        if duration * (fastest + 0.5 * drift) <= _DEEP * size.min(initial=np.inf):
            return 1
        first, second = self._pairs.T
        past = np.linalg.norm(velocity[second] - velocity[first], axis=1) + turning[first] + turning[second]
        moved = duration * (past + drift)
        fast = np.flatnonzero(0.5 * moved > _DEEP * size)
        most = max((0.5 * moved[k] / size[k] for k in fast.tolist() if self._meets(data, k, moved[k])), default=0.0)
        return math.ceil(max(1.0, most / _DEEP))

    def _meets(self, data: mujoco.MjData, pair: int, moved: float) -> bool:
        """Return whether a pair can meet if its geoms move past each other by this distance, m."""
        first, second = self._pairs[pair].tolist()
        return mujoco.mj_geomDistance(self._model, data, first, second, moved, None) < moved
