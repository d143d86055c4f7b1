"""MuJoCo's collision detection, with the contacts of cylinders corrected that stand on planes or side by side."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.errors import SceneError

_FULL = int(mujoco.mjtWarning.mjWARN_CONTACTFULL)
_PLANE, _CYLINDER, _CAPSULE = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "CYLINDER", "CAPSULE")
)


class Cylinders(NamedTuple):
    """The geoms of a scene that matter for the contacts of cylinders which `collide` corrects."""

    planes: np.ndarray  # on which cylinders can stand
    cylinders: np.ndarray
    beside: bool  # whether two can touch side by side


def cylinders_of(model: mujoco.MjModel) -> Cylinders | None:
    """Return the planes and cylinders of a scene; None if it has no cylinders that stand or touch side by side."""
    planes, cylinders, capsules = (np.flatnonzero(model.geom_type == kind) for kind in (_PLANE, _CYLINDER, _CAPSULE))
    beside = len(cylinders) + len(capsules) > 1
    return Cylinders(planes, cylinders, beside) if len(cylinders) and (beside or len(planes)) else None


def collide(model: mujoco.MjModel, data: mujoco.MjData, cylinders: Cylinders | None = None) -> None:
    """Run MuJoCo's collision detection at the current frames (`update_positions`); replaces data.contact.

    With the result of `cylinders_of`, the contacts of cylinders that stand on planes or side by side are corrected.
    """
    if cylinders is None or not _can_meet(model, cylinders):
        _find_contacts(model, data)
        return
    # compiled code, which reading other scenes should not load
    from impactlaw.scene.corrected.rounding import align, measure_again
    from impactlaw.scene.corrected.side_by_side import put_in_between

    frames = data.geom_xmat.copy()
    try:
        align(cylinders.planes, cylinders.cylinders, data.geom_xmat)  # so that MuJoCo finds contacts of upright ones
        _find_contacts(model, data)
    finally:
        data.geom_xmat[:] = frames
    if data.ncon:
        found, shapes = data.contact, (model.geom_type, model.geom_size, data.geom_xpos, data.geom_xmat)
        measure_again(*shapes, found.geom, found.dist, found.pos, found.frame)
        if cylinders.beside:
            bodies = model.body_invweight0, data.subtree_com, model.geom_bodyid, model.body_weldid
            put_in_between(shapes, *bodies, found.geom, found.pos, found.frame)


def _can_meet(model: mujoco.MjModel, geoms: Cylinders) -> bool:
    """Return whether such contacts are possible now; those of pictures have no contacts."""
    masks = model.geom_contype | model.geom_conaffinity
    others = geoms.beside or bool(np.count_nonzero(masks[geoms.planes]))
    return model.npair > 0 or (others and bool(np.count_nonzero(masks[geoms.cylinders])))


def _find_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    numbers = data.warning.number
    before = numbers[_FULL]
    mujoco.mj_collision(model, data)
    if numbers[_FULL] != before:
        raise SceneError(
            f'MuJoCo has no room for more than {data.ncon} contacts; give the scene a larger <size memory="..."/>'
        )
