"""What a compiled scene says to the law layer: which geoms can meet, what is not covered, and its own restitution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from impactlaw.scene.contacts import geom_names
from impactlaw.errors import RestitutionError, SceneError, UnknownNameError
from impactlaw.laws import Newton
from impactlaw.laws.base import coefficient
from impactlaw.scene.joint_limits import Limits
from impactlaw.scene.friction_rows import MIN_FRICTION, pair_friction

RESTITUTION = "restitution"
"""``<custom><numeric name="restitution" data="0.5"/>`` is a scene's default coefficient;
``<numeric name="restitution/geomA/geomB" data="0.9"/>`` is that of one pair, in either order;
``<numeric name="restitution/joint" data="0.2"/>`` that of the limits of a joint or tendon."""

_RESOLVED = 1e-15  # part of the size of the scene that gaps are rounded to


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


def check_resolved(model: mujoco.MjModel, gap_tolerance: float) -> None:
    """Refuse a gap tolerance that positions cannot resolve: contacts would open and close by rounding.

    Raises:
        SceneError: the tolerance is below the rounding of the largest size or distance in the scene.
    """
    extent = max(np.abs(model.body_pos).max(), model.geom_rbound.max(initial=0.0))
    if gap_tolerance < _RESOLVED * extent:
        raise SceneError(
            f"a gap tolerance of {gap_tolerance:g} m is below the rounding of positions in a scene of {extent:.2g} m; "
            f"pass gap_tolerance={1e-9 * extent:.0e}, or at least {_RESOLVED * extent:.0e}"
        )


def check_rigid(model: mujoco.MjModel) -> None:
    """Refuse what rigid stepping would simulate wrongly.

    Raises:
        SceneError: flexes, adhesion, delays, geoms whose shape is a signed distance function.
    """
    check_time_stepping(model)
    meeting = geom_pairs(model).geoms
    shaped = meeting[model.geom_type[meeting] == int(mujoco.mjtGeom.mjGEOM_SDF)]
    if len(shaped):
        raise SceneError(
            f"MuJoCo samples the contacts of signed distance functions ({geom_names(model)[shaped[0]]} is one): "
            'no gap can be located; use scheme="time-stepping", or contact_model="soft"'
        )
    adhesion = int(mujoco.mjtTrn.mjTRN_BODY)
    if model.flg_adhesion or (model.nu and (model.actuator_trntype == adhesion).any()):
        raise SceneError(
            "contacts that are located do not pull, but the scene has adhesion; "
            'use scheme="time-stepping" or contact_model="soft"'
        )


def check_time_stepping(model: mujoco.MjModel) -> None:
    """Refuse what no scheme of rigid stepping covers.

    Raises:
        SceneError: flexes, delays.
    """
    if model.nflex:
        raise SceneError('rigid stepping is between geoms only, but the scene has a flex; use contact_model="soft"')
    if model.nhistory:
        raise SceneError(
            "MuJoCo's buffers of delayed actuators and sensors take one sample a step of MuJoCo's own; "
            'use contact_model="soft", or leave out delay and nsample'
        )


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


def scene_law(model: mujoco.MjModel) -> Newton:
    """Return the law that the scene itself carries: Newton, keyed by geom pairs, joints and tendons.

    Raises:
        RestitutionError: the scene names no restitution, or a coefficient is not one number in [0, 1].
        UnknownNameError: a coefficient is of something that the scene does not have.
    """
    names, limits = geom_names(model), Limits(model).names
    table: dict[str | tuple[str, str], float] = {}
    default = None
    for i in range(model.nnumeric):
        numeric = model.numeric(i)
        if numeric.name == RESTITUTION:
            default = _one_coefficient(numeric)
        elif numeric.name.startswith(f"{RESTITUTION}/"):
            table[_split_name(numeric.name, names, limits)] = _one_coefficient(numeric)
    if default is None and not table:
        raise RestitutionError(
            'the scene carries no restitution; add <custom><numeric name="restitution" data="0.5"/></custom> '
            "or pass a law"
        )
    return Newton(table, default=default)


def _one_coefficient(numeric: Any) -> float:
    """Return the coefficient that a ``<numeric>`` carries.

    Raises:
        RestitutionError: it has not one value, or that is not in [0, 1].
    """
    if len(numeric.data) != 1:
        raise RestitutionError(f"{numeric.name} of the scene must be one number in [0, 1], but has {len(numeric.data)}")
    return coefficient(numeric.data[0], f"{numeric.name} of the scene")


def scene_number(model: mujoco.MjModel, name: str) -> float | None:
    """Return the first value of ``<numeric name=...>`` in the scene's ``<custom>``, or None."""
    index = mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_NUMERIC), name)
    return None if index < 0 else float(model.numeric(index).data[0])


def _split_name(name: str, names: tuple[str, ...], limits: tuple[str, ...]) -> str | tuple[str, str]:
    """Split ``restitution/a/b`` where the geoms' own names may hold slashes; ``restitution/a`` is a joint or tendon."""
    parts = name.split("/")[1:]
    if "/".join(parts) in limits:
        return "/".join(parts)
    for cut in range(1, len(parts)):
        pair = "/".join(parts[:cut]), "/".join(parts[cut:])
        if pair[0] in names and pair[1] in names:
            return pair
    known = {f"{a}/{b}" for a in names for b in names if a < b}
    raise UnknownNameError("geom pair, or joint or tendon with a limit,", "/".join(parts), known | set(limits))
