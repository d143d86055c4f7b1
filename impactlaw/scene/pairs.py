"""Which geoms of a scene can meet, and how thick they are."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from impactlaw.scene.friction_rows import pair_friction
from impactlaw.scene.tolerances import MIN_FRICTION


@dataclass(frozen=True, eq=False)
class GeomPairs:
    """Pairs of geoms that MuJoCo's filters let collide.

    Attributes:
        geoms: geom ids, the lower one first, int (p, 2).
        friction: whether contacts of the pair have friction, bool (p,).
    """

    geoms: np.ndarray
    friction: np.ndarray


def geom_pairs(model: mujoco.MjModel) -> GeomPairs:
    """List the pairs of geoms that can collide.

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
    dim, mu = pair_friction(model, geoms)
    return GeomPairs(geoms, (dim > 1) & (mu[:, :2].max(axis=1, initial=0.0) > MIN_FRICTION))


def thickness(model: mujoco.MjModel) -> np.ndarray:
    """Smallest half-extent of each geom, m, (ngeom,); planes have no end."""
    result = np.empty(model.ngeom)
    for geom in range(model.ngeom):
        kind, size = model.geom_type[geom], model.geom_size[geom]
        if kind == int(mujoco.mjtGeom.mjGEOM_PLANE):
            result[geom] = np.inf
        elif kind in (int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)):
            result[geom] = size[0]
        elif kind == int(mujoco.mjtGeom.mjGEOM_CYLINDER):
            result[geom] = min(size[:2])
        else:
            result[geom] = model.geom_aabb[geom, 3:].min()
    return result
