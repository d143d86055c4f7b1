"""What tasks add to scenes: marks."""

from __future__ import annotations

import mujoco


def add_mark(spec: mujoco.MjSpec, name: str, radius: float) -> None:
    """Add the ghost of a ball, which touches nothing, on a mocap body: the task puts it where its target is."""
    body = spec.worldbody.add_body(name=name, mocap=True)
    mark = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius] * 3, rgba=[0.1, 0.7, 0.3, 0.3])
    mark.contype = mark.conaffinity = 0
