"""Marks that tasks add to scenes."""

from __future__ import annotations

import mujoco


def add_mark(spec: mujoco.MjSpec, name: str, radius: float) -> None:
    """Add a translucent ball without contacts on a mocap body, which the task places at its target."""
    body = spec.worldbody.add_body(name=name, mocap=True)
    mark = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius] * 3, rgba=[0.1, 0.7, 0.3, 0.3])
    mark.contype = mark.conaffinity = 0
