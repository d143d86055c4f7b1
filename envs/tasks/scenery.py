"""Marks that tasks add to scenes."""

from __future__ import annotations

import mujoco


def add_target(spec: mujoco.MjSpec, radius: float) -> None:
    """Add a translucent ball without contacts on a mocap body "target", which the task places at its target."""
    body = spec.worldbody.add_body(name="target", mocap=True)
    mark = body.add_geom(name="target", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius] * 3, rgba=[0.1, 0.7, 0.3, 0.3])
    mark.contype = mark.conaffinity = 0
