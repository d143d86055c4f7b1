"""Pairs of geoms that can collide, the thickness of geoms, and properties of contacts that follow from geom types."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw.scene.friction_rows import pair_friction
from impactlaw.scene.tolerances import MIN_FRICTION, SKIN


@dataclass(frozen=True, eq=False)
class GeomPairs:
    """The pairs of geoms that can collide under MuJoCo's filters."""

    geoms: np.ndarray  # geom ids, the lower one first, int (p, 2)
    friction: np.ndarray  # whether contacts of the pair have friction, bool (p,)


def geom_pairs(model: mujoco.MjModel) -> GeomPairs:
    """Return the pairs of geoms that can collide.

    MuJoCo's rules: explicit pairs, contype and conaffinity, welded and parent-child bodies, excluded bodies, and bodies
    that cannot move, fixed or mocap.
    """
    first, second = np.triu_indices(model.ngeom, k=1)
    contype, conaffinity = model.geom_contype, model.geom_conaffinity
    allowed = (contype[first] & conaffinity[second]) | (contype[second] & conaffinity[first])
    keep = np.flatnonzero(allowed)
    first, second = first[keep], second[keep]
    body1, body2 = model.geom_bodyid[first], model.geom_bodyid[second]
    weld1, weld2 = model.body_weldid[body1], model.body_weldid[body2]
    apart = (weld1 != weld2) & ((model.body_treeid[body1] >= 0) | (model.body_treeid[body2] >= 0))
    if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        parent1 = model.body_weldid[model.body_parentid[weld1]]
        parent2 = model.body_weldid[model.body_parentid[weld2]]
        apart &= ~(((weld1 != 0) & (weld2 != 0)) & ((weld1 == parent2) | (weld2 == parent1)))
    signature = (np.minimum(body1, body2) << 16) + np.maximum(body1, body2)
    excluded = [
        ((min(s >> 16, s & 0xFFFF)) << 16) + max(s >> 16, s & 0xFFFF) for s in map(int, model.exclude_signature)
    ]
    apart &= ~np.isin(signature, excluded)
    first, second = first[apart], second[apart]
    pairs = np.sort(np.column_stack([model.pair_geom1, model.pair_geom2]), axis=1).reshape(-1, 2)
    geoms = np.concatenate([np.column_stack([first, second]), pairs]).astype(int)
    dim, mu = pair_friction(model, geoms, overridden=True)
    return GeomPairs(geoms, np.any((np.arange(5) < dim[:, None] - 1) & (mu > MIN_FRICTION), axis=1))


def thickness(model: mujoco.MjModel) -> np.ndarray:
    """Return the smallest half-extent of each geom, m, (ngeom,); it is infinite for planes."""
    kind, size, box = model.geom_type, model.geom_size, model.geom_aabb[:, 3:].min(axis=1, initial=np.inf)
    known = [_PLANE[kind], _THREAD[kind], _CYLINDER[kind]]
    return np.select(known, [np.full(len(kind), np.inf), size[:, 0], size[:, :2].min(axis=1)], box)


def _kinds(*names: str) -> np.ndarray:
    """Return a bool table over geom types in which these types are True."""
    table = np.zeros(int(mujoco.mjtGeom.mjGEOM_SDF) + 1, dtype=bool)
    table[[int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in names]] = True
    return table


_PLANE = _kinds("PLANE")
_THREAD = _kinds("SPHERE", "CAPSULE")  # half-extent is the radius
_CYLINDER = _kinds("CYLINDER")
_ROD = _kinds("CYLINDER", "CAPSULE")
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


def vague_contacts(model: mujoco.MjModel, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which pairs of geoms may touch anywhere on common faces, at points that may change, bool (n,).

    Also return which of their contacts move along one edge or face, not from piece to piece of a surface, bool (n,).
    """
    kind = model.geom_type[geoms]
    vague = np.any(_VAGUE[kind], axis=1) & ~np.any(_SPHERE[kind], axis=1) & ~one_contact(model, geoms)
    return vague, vague & ~np.any(_PIECES[kind], axis=1)


def several_contacts(model: mujoco.MjModel, geoms: np.ndarray) -> np.ndarray:
    """Return the pairs of geoms for which MuJoCo looks for several contacts between faces (``multiccd``), bool (n,)."""
    kind = model.geom_type[geoms]
    return np.logical_and(np.all(_FACED[kind], axis=1), np.any(_MANIFOLD[kind], axis=1))


def some_side_by_side(model: mujoco.MjModel) -> bool:
    """Return whether cylinders, capsules or boxes of a scene can touch each other along a line.

    Masks that are changed later may let them.
    """
    return len(np.unique(model.body_weldid[model.geom_bodyid[(_ROD | _BOX)[model.geom_type]]])) > 1
