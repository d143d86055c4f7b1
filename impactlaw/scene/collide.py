"""MuJoCo's collision detection, with corrected contacts of cylinders on planes and of geoms that touch along a line."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.errors import SceneError
from impactlaw.scene.contacts import Contacts
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.pairs import some_side_by_side

_GEOM, _FULL = mujoco.mjtObj.mjOBJ_GEOM, int(mujoco.mjtWarning.mjWARN_CONTACTFULL)
_PLANE, _CYLINDER, _CAPSULE, _BOX, *_PIECES = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "CYLINDER", "CAPSULE", "BOX", "MESH", "HFIELD")
)


class CorrectedGeoms(NamedTuple):
    """The geoms of a scene that matter for the contacts of cylinders, capsules and boxes which `collide` corrects."""

    planes: np.ndarray  # on which cylinders can stand
    cylinders: np.ndarray
    is_cylinder: np.ndarray  # bool (ngeom,)
    is_straight: np.ndarray  # whether a geom is a cylinder, a capsule or a box, bool (ngeom,)
    lines: tuple[int, ...]  # for each geom 2 for a cylinder or a capsule, 1 for a box, else 0
    on_faces: bool  # whether these can lie on the faces of boxes, meshes or height fields
    beside: bool  # whether any of these can touch along a line


def corrected_geoms(model: mujoco.MjModel) -> CorrectedGeoms | None:
    """Return these geoms of a scene; None if it has no cylinders, nor geoms that touch along a line."""
    kind, beside = model.geom_type, some_side_by_side(model)
    is_cylinder, is_long = kind == _CYLINDER, (kind == _CYLINDER) | (kind == _CAPSULE)
    planes, cylinders = np.flatnonzero(kind == _PLANE), np.flatnonzero(is_cylinder)
    if not beside and len(cylinders) == 0:
        return None
    on_faces = len(cylinders) > 0 and bool(np.isin(kind, [_BOX, *_PIECES]).any())
    lines = 2 * is_long + (kind == _BOX)
    return CorrectedGeoms(planes, cylinders, is_cylinder, lines > 0, tuple(lines.tolist()), on_faces, beside)


def collide(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    chosen: CorrectedGeoms | None,
    *,
    stands: bool,
    surfaces: Surfaces | None = None,
) -> None:
    """Run MuJoCo's collision detection at the current frames (`update_positions`); replaces data.contact.

    With the result of `present`, the contacts of cylinders on planes, boxes, meshes and each other are corrected;
    ``surfaces`` are those that move by themselves.
    """
    if stands and chosen is not None:
        _find_standing(model, data, chosen, surfaces)
    else:
        _find_contacts(model, data)
    if chosen is None or data.ncon == 0 or not (chosen.on_faces or chosen.beside):
        return
    geoms = data.contact.geom
    if chosen.on_faces and np.count_nonzero(chosen.is_cylinder[geoms]):
        _compiled().meet_axes(*_shapes(model, data), geoms, data.contact.pos, data.contact.frame)
    if chosen.beside and _some_on_lines(chosen.lines, geoms):
        code, found = _compiled(), data.contact
        most = code.room(data.ncon)
        owner, added = np.empty(most, np.int64), np.empty((most, code.END))
        _, many = code.find_ends(
            _shapes(model, data), geoms, found.includemargin, found.dist, found.pos, found.frame, owner, added
        )
        _add(model, data, owner[:many], added)


@cache
def _compiled() -> SimpleNamespace:
    """Return the compiled code that corrects contacts, which reading other scenes should not load."""
    from impactlaw.compiled import for_python
    from impactlaw.scene.corrected.rounding import align, measure_standing, meet_axes
    from impactlaw.scene.corrected.side_by_side import END, find_ends, room
    from impactlaw.scene.corrected.standing import turn_standing

    parts = {part.__name__: for_python(part) for part in (measure_standing, turn_standing, meet_axes, find_ends)}
    return SimpleNamespace(align=align, END=END, room=room.py_func, **parts)


def _some_on_lines(lines: tuple[int, ...], geoms: np.ndarray) -> bool:
    """Return whether any contact can lie on a line: of a cylinder or capsule, or the only one of two boxes."""
    pairs = geoms.tolist()
    for k, pair in enumerate(pairs):
        both = lines[pair[0]] * lines[pair[1]]
        if both > 1 or (both == 1 and pair not in (*pairs[max(k - 1, 0) : k], *pairs[k + 1 : k + 2])):
            return True
    return False


def _shapes(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, ...]:
    return model.geom_type, model.geom_size, data.geom_xpos, data.geom_xmat


def _find_standing(
    model: mujoco.MjModel, data: mujoco.MjData, chosen: CorrectedGeoms, surfaces: Surfaces | None
) -> None:
    """Find contacts, those of cylinders that stand on planes in the right places, with the right distances."""
    code, frames = _compiled(), data.geom_xmat.copy()
    try:  # so that MuJoCo finds contacts of upright ones
        standing = code.align(chosen.planes, chosen.cylinders, model.geom_size, data.geom_xmat)
        _find_contacts(model, data)
    finally:
        data.geom_xmat[:] = frames
    if data.ncon == 0:
        return
    if len(standing):
        _find_corners(model, data, standing, surfaces)
    found = data.contact
    code.measure_standing(*_shapes(model, data), found.geom, found.dist, found.pos, found.frame)


def _find_corners(model: mujoco.MjModel, data: mujoco.MjData, standing: np.ndarray, surfaces: Surfaces | None) -> None:
    """Give cylinders that stand on planes, (k, 2), four contacts; see `corrected.standing`."""
    mujoco.mj_comVel(model, data)
    _, size, place, turn = _shapes(model, data)
    for pair in standing:
        found, motion = data.contact, _motion(model, data, pair, surfaces)
        points = found.pos
        first = _compiled().turn_standing(pair, size, place, turn, found.geom, points, motion, model.opt.gravity)
        if first < 0:
            continue
        opposite = points[first + 1] + points[first + 2] - points[first]
        if mujoco.mj_addContact(model, data, found[first]):
            raise _no_room(data)
        data.contact[data.ncon - 1].pos = opposite


def _motion(model: mujoco.MjModel, data: mujoco.MjData, pair: np.ndarray, surfaces: Surfaces | None) -> np.ndarray:
    """Return angular velocity and velocity of a cylinder, rad/s and m/s, (6,), relative to a plane; cvel is current."""
    plane, own = pair.tolist()
    moves = np.empty(6)
    mujoco.mj_objectVelocity(model, data, _GEOM, own, moves, 0)
    if surfaces is not None and (surfaces.move or surfaces.run):
        place, normal = data.geom_xpos[own], data.geom_xmat[plane].reshape(3, 3)[:, 2]
        motion = surfaces.motion(data, Contacts((), pair[None], np.zeros(1), place[None], normal[None]))
        moves += np.append(motion.spin + motion.belt_spin, motion.velocity + motion.belt)
    return moves


def _add(model: mujoco.MjModel, data: mujoco.MjData, owner: np.ndarray, places: np.ndarray) -> None:
    """Add copies of contacts at other places; see `side_by_side.find_ends`."""
    for k, place in zip(owner.tolist(), places, strict=False):
        if mujoco.mj_addContact(model, data, data.contact[k]):
            raise _no_room(data)
        added = data.contact[data.ncon - 1]
        added.dist, added.pos, added.frame = place[0], place[1:4], place[4:]


def present(model: mujoco.MjModel, geoms: CorrectedGeoms) -> tuple[CorrectedGeoms | None, bool]:
    """Return the geoms if any can be in contact now (those of pictures cannot), and whether cylinders can stand."""
    meets = (model.geom_contype | model.geom_conaffinity != 0) | (model.npair > 0)
    if not (meets & geoms.is_straight).any():
        return None, False
    if not meets[geoms.cylinders].any():
        return geoms._replace(on_faces=False), False
    return geoms, bool(meets[geoms.planes].any())


def _find_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    warnings = data.warning.number
    full = warnings[_FULL]
    mujoco.mj_collision(model, data)
    if warnings[_FULL] != full:
        raise _no_room(data)


def _no_room(data: mujoco.MjData) -> SceneError:
    reason = f"MuJoCo has no room for more than {data.ncon} contacts"
    return SceneError(f'{reason}; give the scene a larger <size memory="..."/>')
