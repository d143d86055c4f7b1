"""Measure how far geoms travel, so that no body passes through another unseen."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.scene.detection import Distances
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.pairs import GeomPairs, thickness

_FREE, _BALL, _SLIDE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "BALL", "SLIDE"))
_FAR = 1e100  # m: bound on how far a slide moves the geoms beyond it


class Frames(NamedTuple):
    """Positions (ngeom, 3) and orientations (ngeom, 9) of all geoms at one time."""

    position: np.ndarray
    rotation: np.ndarray

    @classmethod
    def of(cls, data: mujoco.MjData) -> Frames:
        """Copy the current frames."""
        return cls(data.geom_xpos.copy(), data.geom_xmat.copy())


class Travel:
    """Measures how far geoms move in a phase, and how long it may be so that no body passes through another unseen.

    A pair is safe if one geom has moved past the other by at most the pair's thickness (the sum of the smallest
    half-extents), or by at most their distance at the start of the phase. Bodies that fly side by side are safe at any
    speed. Rotation counts if ``turning`` is set.

    Attributes:
        farthest: bound on the motion of a point of a geom, m per unit of displacement of all coordinates together.
    """

    def __init__(
        self, model: mujoco.MjModel, pairs: GeomPairs, surfaces: Surfaces | None, *, passing: bool, turning: bool
    ):
        self._model, self._surfaces = model, surfaces
        thin = thickness(model)
        self._radius = model.geom_rbound.copy()
        self._lever = np.where(np.isfinite(thin), np.maximum(self._radius - thin, 0.0), 0.0)
        finite = np.isfinite(thin[pairs.geoms]).all(axis=1)
        self._pairs = pairs.geoms[finite]
        self._thickness = thin[self._pairs].sum(axis=1)
        kind, first = model.jnt_type[model.dof_jntid], model.jnt_dofadr[model.dof_jntid]
        turns = (kind == mujoco.mjtJoint.mjJNT_FREE) & (np.arange(model.nv) >= first + 3)
        self._spins = turns | (kind == mujoco.mjtJoint.mjJNT_BALL) | (kind == mujoco.mjtJoint.mjJNT_HINGE)
        self._round = not turning
        self._passable = passing or turning
        self._chains = self._reaches(pairs.geoms[np.isfinite(thin[pairs.geoms])])
        self._bounds, self._short = self._chains, 0.5 * self._thickness.min(initial=np.inf)
        if not self._round:
            self._short = min(self._short, 1.0)
            turned = self._spins & ((self._chains > 0.0) | ~self._chains.any(axis=0))
            self._bounds = np.maximum(self._chains, self._short * turned)
        self.farthest = float(np.linalg.norm(self._bounds.max(axis=0, initial=0.0)))
        self._closing = np.linalg.norm(self._chains, axis=1)[pairs.geoms].sum(axis=1).max(initial=0.0).item()

    def is_short(self, before: np.ndarray, after: np.ndarray, duration: float) -> bool:
        """Return whether no body can have passed through another, or turned so far that orientations alias.

        This is a bound from the velocities, (nv,), at both ends of a phase. Where it fails, `between` is more precise.
        """
        if not self._passable:
            return True
        short = self._short if self._surfaces is None else self._short - 2.0 * self.drift(duration)
        if self.farthest * (mujoco.mju_norm(before) + mujoco.mju_norm(after)) * duration <= short:
            return True
        return max(self._bounds.dot(np.abs(before) + np.abs(after)).tolist()) * duration <= short

    def drift(self, duration: float) -> float:
        """Return how far surfaces that move by themselves can have moved in a phase, m."""
        return 0.0 if self._surfaces is None else self._surfaces.speed * duration

    def closing(self, before: np.ndarray, after: np.ndarray, duration: float) -> float:
        """Return a bound on how much closer two geoms can have come in a phase, m, from the velocities, (nv,)."""
        return self._closing * max(mujoco.mju_norm(before), mujoco.mju_norm(after)) * duration

    def _reaches(self, geoms: np.ndarray) -> np.ndarray:
        """Return a bound on the motion of each geom's points by each coordinate, m per m or per rad, (ngeom, nv)."""
        model = self._model
        reach = np.zeros((model.ngeom, model.nv))
        for geom in np.unique(geoms):
            arm, body = model.geom_rbound[geom] + np.linalg.norm(model.geom_pos[geom]), model.geom_bodyid[geom]
            while body:
                first, count = model.body_jntadr[body], model.body_jntnum[body]
                for joint in reversed(range(first, first + count)):
                    kind, dof = int(model.jnt_type[joint]), int(model.jnt_dofadr[joint])
                    offset = float(np.linalg.norm(model.jnt_pos[joint]))
                    size = {_FREE: 6, _BALL: 3}.get(kind, 1)
                    if kind in (_FREE, _SLIDE):
                        reach[geom, dof : dof + size] = 1.0
                    if kind != _SLIDE:
                        reach[geom, dof + 3 if kind == _FREE else dof : dof + size] = arm + offset
                    arm += _FAR if kind == _SLIDE else 2.0 * offset
                arm += np.linalg.norm(model.body_pos[body])
                body = model.body_parentid[body]
        return reach

    def between(self, start: Frames, data: mujoco.MjData) -> np.ndarray:
        """Return a bound on the travel of each geom's surface since the start, m, (ngeom,)."""
        shift = data.geom_xpos - start.position
        return np.sqrt(np.vecdot(shift, shift)) + self._turned(start, data)

    def _turned(self, start: Frames, data: mujoco.MjData) -> np.ndarray:
        """Return the part of `between` that is due to rotation, m, (ngeom,)."""
        turn = data.geom_xmat - start.rotation
        return self._lever * np.sqrt(0.5 * np.vecdot(turn, turn))

    def by(self, before: np.ndarray, after: np.ndarray, duration: float) -> np.ndarray:
        """Return a bound on the travel of each geom that can meet another, m, (ngeom,), from the velocities, (nv,)."""
        return self._chains.dot(np.maximum(np.abs(before), np.abs(after))) * duration

    def along(self, start: Frames, data: mujoco.MjData, apart: Distances) -> np.ndarray:
        """Return a bound on the opening of pairs of geoms along their current normals, m, (h,)."""
        shift, (first, second) = data.geom_xpos - start.position, apart.geoms.T
        opened = np.vecdot(apart.normal, shift[second] - shift[first])
        if self._round:
            return opened
        turned = self._turned(start, data)
        return opened + turned[first] + turned[second]

    def suspects(self, start: Frames, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Return the indices of pairs that may have passed through each other since the start, (k,).

        Also return how far one geom of each pair has moved past the other, m, (k,).
        """
        (first, second), turned = self._pairs.T, self._turned(start, data)
        shift = data.geom_xpos - start.position
        moved = np.linalg.norm(shift[second] - shift[first], axis=1) + turned[first] + turned[second]
        far = np.flatnonzero(moved > self._thickness)
        first, second, moved = first[far], second[far], moved[far]
        apart = np.linalg.norm(start.position[first] - start.position[second], axis=1)
        near = apart - (self._radius[first] + self._radius[second]) <= moved
        return far[near], moved[near]

    def is_safe(self, start: Frames, before: np.ndarray, data: mujoco.MjData, duration: float) -> bool:
        """Return whether no body has passed through another in a phase, given frames and velocity at its start."""
        return duration <= self.longest_turn(before) and not len(self.suspects(start, data)[0])

    def safe_fraction(self, data: mujoco.MjData, suspects: np.ndarray, moved: np.ndarray) -> float:
        """Return the part of the phase after which no suspect can have passed through; data is at the phase's start."""
        fraction = 1.0
        for k, far in zip(suspects, moved.tolist(), strict=True):
            first, second = self._pairs[k]
            distance = mujoco.mj_geomDistance(self._model, data, first, second, far, None)
            fraction = min(fraction, max(self._thickness[k], distance) / far)
        return fraction

    def longest_turn(self, velocity: np.ndarray) -> float:
        """Return the duration, s, in which the fastest joint turns by one radian; beyond it orientations alias."""
        if self._round:
            return np.inf
        fastest = np.abs(velocity[self._spins]).max(initial=0.0)
        return 1.0 / fastest if fastest > 0 else np.inf
