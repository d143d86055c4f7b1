"""What the types of two geoms say about their contacts, as MuJoCo's collision detection finds them."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.tolerances import SKIN


def _kinds(*names: str) -> np.ndarray:
    """Return a table by geom type with these types marked, bool."""
    table = np.zeros(int(mujoco.mjtGeom.mjGEOM_SDF) + 1, dtype=bool)
    table[[int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in names]] = True
    return table


_BOX = _kinds("BOX")
_SPHERE = _kinds("SPHERE")
_ROUND = _kinds("SPHERE", "ELLIPSOID")
_EXACT = _kinds("PLANE", "SPHERE", "CAPSULE")
_PIECES = _kinds("HFIELD", "SDF")
_FACED = _kinds("CAPSULE", "CYLINDER", "BOX", "MESH")
_MANIFOLD = _kinds("CYLINDER", "MESH")
_VAGUE = _MANIFOLD | _PIECES


def touching_distance(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return the distance at which pairs of geoms touch, 0 or `SKIN`, m, (n,); takes geom ids, (n, 2)."""
    kind = model.geom_type[geoms]
    return np.where(np.any(_EXACT[kind], axis=1) | np.all(_BOX[kind], axis=1), 0.0, SKIN)


def one_contact(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return which pairs of geoms never have more than one contact, bool (n,)."""
    kind = model.geom_type[geoms]
    return np.logical_and(np.any(_ROUND[kind], axis=1), ~np.any(_PIECES[kind], axis=1))


def vague_contacts(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return which pairs of geoms may touch anywhere in common faces, not always in the same points, bool (n,)."""
    kind = model.geom_type[geoms]
    several = np.any(_VAGUE[kind], axis=1) & ~np.any(_SPHERE[kind], axis=1)
    return np.logical_and(several, ~one_contact(model, geoms))


def rolling_contacts(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return which vague contacts run along one edge or face, not from piece to piece of a surface, bool (n,)."""
    return vague_contacts(model, geoms) & ~np.any(_PIECES[model.geom_type[geoms]], axis=1)


def several_contacts(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return for which pairs of geoms MuJoCo looks for several contacts between faces (``multiccd``), bool (n,)."""
    kind = model.geom_type[geoms]
    return np.logical_and(np.all(_FACED[kind], axis=1), np.any(_MANIFOLD[kind], axis=1))
