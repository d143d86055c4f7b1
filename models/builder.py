"""Chains, cradles and stacks of any size, in the conventions of the scenes, on `mujoco.MjSpec`.

Lengths that are powers of two, as the defaults are, keep every gap at exactly 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any, Literal

import mujoco
import numpy as np

from impactlaw.errors import SceneError
from impactlaw.models import START

_SHAPES = {"ball": mujoco.mjtGeom.mjGEOM_SPHERE, "box": mujoco.mjtGeom.mjGEOM_BOX}


def chain(
    n: int, *, mass: float | Sequence[float] = 1.0, radius: float = 0.125, launched: int = 1, restitution: float = 1.0
) -> mujoco.MjSpec:
    """Return n balls on a line along x, in touch, without gravity; the first ones start at 1 m/s.

    Args:
        n: number of balls; geoms, bodies and slide joints are ``ball1`` .. ``ball<n>``.
        mass: of every ball, or one per ball, kg.
        radius: of every ball, m.
        launched: how many balls start at 1 m/s.
        restitution: the scene's coefficient.

    Raises:
        SceneError: a number is none, or of the wrong sign; n, the number of masses or of launched balls do not fit.
    """
    masses = _per_body(n, mass)
    _check_positive(radius=radius)
    spec = _spec(f"chain{n}", gravity=0.0, timestep=0.01, integrator=mujoco.mjtIntegrator.mjINT_EULER)
    for i, m in enumerate(masses):
        body = spec.worldbody.add_body(name=f"ball{i + 1}", pos=[2 * radius * i, 0, 0])
        body.add_joint(name=f"ball{i + 1}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
        _add_geom(body, f"ball{i + 1}", "ball", radius, m)
    return _finish(spec, restitution, qpos=[0.0] * n, qvel=_launch(n, launched))


def cradle(
    n: int,
    *,
    mass: float | Sequence[float] = 1.0,
    radius: float = 0.125,
    length: float = 1.0,
    launched: int = 1,
    restitution: float = 1.0,
) -> mujoco.MjSpec:
    """Return Newton's cradle with n balls hanging in touch from hinges; the first ones start at 1 rad/s.

    Args:
        n: number of balls; geoms, bodies and hinges are ``ball1`` .. ``ball<n>``.
        mass: of every ball, or one per ball, kg.
        radius: of every ball, m.
        length: from the hinges to the centers, m.
        launched: how many balls start at 1 rad/s.
        restitution: the scene's coefficient.

    Raises:
        SceneError: a number is none, or of the wrong sign; n, the number of masses or of launched balls do not fit.
    """
    masses = _per_body(n, mass)
    _check_positive(radius=radius, length=length)
    spec = _spec(f"cradle{n}", gravity=-9.81, timestep=0.005, integrator=mujoco.mjtIntegrator.mjINT_RK4)
    for i, m in enumerate(masses):
        body = spec.worldbody.add_body(name=f"ball{i + 1}", pos=[2 * radius * i, 0, 0])
        body.add_joint(name=f"ball{i + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0])
        _add_geom(body, f"ball{i + 1}", "ball", radius, m, pos=(0.0, 0.0, -length))
    return _finish(spec, restitution, qpos=[0.0] * n, qvel=_launch(n, launched))


def stack(
    n: int,
    *,
    mass: float | Sequence[float] = 1.0,
    radius: float = 0.125,
    shape: Literal["ball", "box"] = "ball",
    drop: float = 0.0,
    restitution: float = 0.5,
) -> mujoco.MjSpec:
    """Return a column of n balls or boxes in touch on a plane named ``floor``, free to move up and down only.

    Args:
        n: number of balls or boxes; geoms, bodies and slide joints are ``ball1`` .. or ``box1`` .., upwards.
        mass: of each, or one per ball or box, kg.
        radius: of the balls, or half the edge of the boxes, m.
        shape: balls touch in one point each, boxes in four corners.
        drop: gap below the column at the start, m.
        restitution: the scene's coefficient.

    Raises:
        SceneError: a number is none, or of the wrong sign; n, the number of masses or the shape do not fit.
    """
    if shape not in _SHAPES:
        raise SceneError(f"a stack is of {' or '.join(map(repr, _SHAPES))}, not {shape!r}")
    masses = _per_body(n, mass)
    _check_positive(radius=radius)
    if not _is_number(drop):
        raise SceneError(f"drop must be a number, m, got {drop!r}")
    spec = _spec(f"stack{n}", gravity=-9.81, timestep=0.005, integrator=mujoco.mjtIntegrator.mjINT_RK4)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], condim=1)
    for i, m in enumerate(masses):
        body = spec.worldbody.add_body(name=f"{shape}{i + 1}", pos=[0, 0, radius + 2 * radius * i])
        body.add_joint(name=f"{shape}{i + 1}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        _add_geom(body, f"{shape}{i + 1}", shape, radius, m)
    return _finish(spec, restitution, qpos=[drop] * n, qvel=[0.0] * n)


def _spec(name: str, *, gravity: float, timestep: float, integrator: mujoco.mjtIntegrator) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.option.gravity = [0, 0, gravity]
    spec.option.timestep = timestep
    spec.option.integrator = integrator
    return spec


def _add_geom(body, name: str, shape: str, radius: float, mass: float, pos=(0.0, 0.0, 0.0)) -> None:
    body.add_geom(name=name, type=_SHAPES[shape], size=[radius] * 3, mass=mass, pos=pos, condim=1)


def _finish(spec: mujoco.MjSpec, restitution: float, qpos: list[float], qvel: list[float]) -> mujoco.MjSpec:
    if not (_is_number(restitution) and 0.0 <= restitution <= 1.0):
        raise SceneError(f"restitution must be a number in [0, 1], got {restitution!r}")
    spec.add_numeric(name="restitution", data=[restitution], size=1)
    spec.add_key(name=START, qpos=qpos, qvel=qvel)
    return spec


def _per_body(n: int, mass: float | Sequence[float]) -> list[float]:
    if not isinstance(n, Integral) or n < 1:
        raise SceneError(f"needs a whole number of bodies, at least one, got {n!r}")
    given: Any = mass
    masses = [given] * n if np.ndim(given) == 0 else list(given)
    if len(masses) != n:
        raise SceneError(f"{len(masses)} masses for {n} bodies")
    for one in masses:
        _check_positive(mass=one)
    return [float(one) for one in masses]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and math.isfinite(value)


def _check_positive(**values: object) -> None:
    for name, value in values.items():
        if not (_is_number(value) and value > 0):  # pyright: ignore[reportOperatorIssue]
            raise SceneError(f"{name} must be a positive number, got {value!r}")


def _launch(n: int, launched: int) -> list[float]:
    if not isinstance(launched, Integral) or not 0 <= launched <= n:
        raise SceneError(f"cannot launch {launched!r} of {n} balls")
    return [1.0] * launched + [0.0] * (n - launched)
