"""MuJoCo's collision detection, with the contacts of cylinders corrected that stand on planes or lie side by side."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.errors import SceneError
from impactlaw.scene.pairs import some_side_by_side

_FULL = int(mujoco.mjtWarning.mjWARN_CONTACTFULL)
_PLANE, _CYLINDER, _CAPSULE = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "CYLINDER", "CAPSULE")
)


class Cylinders(NamedTuple):
    """The geoms of a scene that matter for the contacts of cylinders and capsules which `collide` corrects."""

    planes: np.ndarray  # on which cylinders can stand
    cylinders: np.ndarray
    beside: bool  # whether two cylinders or capsules can touch side by side


def cylinders_of(model: mujoco.MjModel) -> Cylinders | None:
    """Return the planes and cylinders of a scene; None if it has no cylinders, nor capsules that touch side by side."""
    planes, cylinders = (np.flatnonzero(model.geom_type == kind) for kind in (_PLANE, _CYLINDER))
    beside = some_side_by_side(model)
    if not beside and len(cylinders) == 0:
        return None
    return Cylinders(planes, cylinders, beside)


def collide(model: mujoco.MjModel, data: mujoco.MjData, cylinders: Cylinders | None = None) -> None:
    """Run MuJoCo's collision detection at the current frames (`update_positions`); replaces data.contact.

    With the result of `cylinders_of`, the contacts of cylinders on planes, boxes, meshes and each other are corrected.
    """
    if cylinders is None:
        _find_contacts(model, data)
        return
    shapes = model.geom_type, model.geom_size, data.geom_xpos, data.geom_xmat
    if _can_stand(model, cylinders):
        _find_standing(model, data, cylinders, shapes)
    else:
        _find_contacts(model, data)
    if data.ncon == 0:
        return
    kinds = model.geom_type[data.contact.geom]
    # imports of compiled code, which reading other scenes should not load
    if len(cylinders.cylinders) and bool((kinds == _CYLINDER).any()):
        from impactlaw.scene.corrected.rounding import put_on_axes

        put_on_axes(*shapes, data.contact.geom, data.contact.pos, data.contact.frame)
    if cylinders.beside and bool(((kinds == _CYLINDER) | (kinds == _CAPSULE)).all(axis=1).any()):
        from impactlaw.scene.corrected.side_by_side import END, find_ends_of_lines

        found, first = data.contact, np.empty((data.ncon + 1, END))
        find_ends_of_lines(shapes, found.geom, found.includemargin, found.dist, found.pos, found.frame, first)
        _add(model, data, first)


def _find_standing(
    model: mujoco.MjModel, data: mujoco.MjData, cylinders: Cylinders, shapes: tuple[np.ndarray, ...]
) -> None:
    """Find contacts, those of cylinders that stand on planes with the right distances."""
    # compiled code, which reading other scenes should not load
    from impactlaw.scene.corrected.rounding import align, measure_again

    frames = data.geom_xmat.copy()
    try:
        align(cylinders.planes, cylinders.cylinders, data.geom_xmat)  # so that MuJoCo finds contacts of upright ones
        _find_contacts(model, data)
    finally:
        data.geom_xmat[:] = frames
    if data.ncon:
        found = data.contact
        measure_again(*shapes, found.geom, found.dist, found.pos, found.frame)


def _add(model: mujoco.MjModel, data: mujoco.MjData, ends: np.ndarray) -> None:
    """Add contacts at further ends of lines; see `side_by_side.find_ends`."""
    for k in np.flatnonzero(np.isfinite(ends[:-1, 0])):
        full = data.warning.number[_FULL]
        mujoco.mj_addContact(model, data, data.contact[k])
        _check_room(data, full)
        added = data.contact[data.ncon - 1]
        added.dist, added.pos, added.frame = ends[k, 0], ends[k, 1:4], ends[k, 4:]


def _can_stand(model: mujoco.MjModel, geoms: Cylinders) -> bool:
    """Return whether cylinders can stand on planes now; those of pictures have no contacts."""
    if len(geoms.cylinders) == 0 or len(geoms.planes) == 0:
        return False
    masks = model.geom_contype | model.geom_conaffinity
    return model.npair > 0 or all(bool(np.count_nonzero(masks[some])) for some in (geoms.planes, geoms.cylinders))


def _find_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    full = data.warning.number[_FULL]
    mujoco.mj_collision(model, data)
    _check_room(data, full)


def _check_room(data: mujoco.MjData, full: int) -> None:
    """Raise `SceneError` if MuJoCo has had no room for contacts since it counted this number of warnings."""
    if data.warning.number[_FULL] != full:
        raise SceneError(
            f'MuJoCo has no room for more than {data.ncon} contacts; give the scene a larger <size memory="..."/>'
        )
