"""MuJoCo's collision detection, with corrected contacts of cylinders on faces and of geoms that touch along a line."""

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
from impactlaw.scene.tolerances import GAP_TOLERANCE

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
        _find_upright(model, data)
    else:
        _find_contacts(model, data)
    if chosen is None or data.ncon == 0:
        return
    some = np.count_nonzero(chosen.is_cylinder[data.contact.geom])
    if some:
        _find_corners(model, data, surfaces)
    geoms = data.contact.geom
    if chosen.on_faces and some:
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
    from impactlaw.scene.corrected.rounding import align, meet_axes
    from impactlaw.scene.corrected.side_by_side import END, find_ends, room
    from impactlaw.scene.corrected.standing import ROOM, find_corners, some_stand

    parts = {part.__name__: for_python(part) for part in (align, meet_axes, some_stand, find_corners, find_ends)}
    return SimpleNamespace(END=END, ROOM=ROOM, room=room.py_func, **parts)


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


def _find_upright(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Find contacts, also those of cylinders that are upright on planes up to rounding, which MuJoCo can miss."""
    frames = data.geom_xmat.copy()
    try:
        _compiled().align(model.geom_type, data.geom_xmat)
        _find_contacts(model, data)
    finally:
        data.geom_xmat[:] = frames


def _find_corners(model: mujoco.MjModel, data: mujoco.MjData, surfaces: Surfaces | None) -> None:
    """Give cylinders that stand or rock on flat faces the corners of their ends; see `corrected.standing`.

    All corners are found where one is near, so that event-driven steps know each of them from look to look.
    """
    code, found, shapes, gravity = _compiled(), data.contact, _shapes(model, data), model.opt.gravity
    geoms, points, frames = found.geom, found.pos, found.frame
    if not code.some_stand(shapes, geoms, frames, gravity):
        return
    mujoco.mj_comVel(model, data)
    motion = np.zeros((data.ncon, 6))
    if surfaces is not None and (surfaces.move or surfaces.run):
        own = surfaces.motion(data, Contacts((), geoms, np.zeros(data.ncon), points, frames[:, :3]))
        motion[:, :3], motion[:, 3:] = own.spin + own.belt_spin, own.velocity + own.belt
    bodies = model.geom_bodyid, model.body_rootid, data.cvel, data.subtree_com
    owner, added = np.empty(code.ROOM * data.ncon, np.int64), np.empty((code.ROOM * data.ncon, code.END))
    _, many = code.find_corners(
        shapes, bodies, geoms, found.includemargin, found.dist, points, frames,
        motion, gravity, 0.5 * GAP_TOLERANCE, owner, added,
    )  # fmt: skip
    _add(model, data, owner[:many], added)


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
