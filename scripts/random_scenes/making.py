"""Random scenes: trees of jointed bodies that fall on a floor, and bodies that fall into a bin."""

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw import Law, MaximalDissipation, Moreau, Newton

_SHAPES = tuple(
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("SPHERE", "BOX", "CAPSULE", "CYLINDER", "ELLIPSOID")
)
_HINGE, _SLIDE, _BALL = (int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("HINGE", "SLIDE", "BALL"))
_INTEGRATORS = tuple(int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("EULER", "RK4", "IMPLICITFAST"))
_RK4 = _INTEGRATORS[1]
_APART = 0.7  # m, distance between roots
_DEPTH = 3  # largest depth of a tree


class Made(NamedTuple):
    """A scene, its start, and the law to step it under."""

    model: mujoco.MjModel
    data: mujoco.MjData
    law: Law


def scene(seed: int, least: int = 2, most: int = 30) -> Made:
    """Return a scene of ``least`` to ``most`` bodies: trees with all kinds of joints, half of them limited, falling."""
    rng = np.random.default_rng(seed)
    spec = _world(rng)
    left, places = int(rng.integers(least, most + 1)), iter(rng.permutation(27))
    while left:
        size, place = min(left, int(rng.integers(1, 6))), next(places)
        left -= size
        where = np.array([place % 3, place // 3 % 3, 1 + place // 9]) * _APART + rng.uniform(-0.05, 0.05, 3)
        _tree(spec, rng, where, size)
    return _compiled(spec, rng)


def pile(seed: int, least: int = 8, most: int = 20) -> Made:
    """Return a bin of four walls into which ``least`` to ``most`` bodies fall."""
    rng = np.random.default_rng(seed)
    spec = _world(rng)
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        wall = [0.02 if x else 0.3, 0.02 if y else 0.3, 0.3]
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=wall, pos=[0.32 * x, 0.32 * y, 0.3])
    for i in range(int(rng.integers(least, most + 1))):
        where = [0.3 * (i % 2) - 0.15, 0.3 * (i // 2 % 2) - 0.15, 0.2 + 0.25 * (i // 4)]
        body = spec.worldbody.add_body(name=f"thing{i}", pos=where, quat=_turn(rng))
        body.add_freejoint()
        _geom(body, rng, largest=0.08)
    return _compiled(spec, rng)


def _world(rng: np.random.Generator) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.option.timestep = float(rng.choice([0.001, 0.002]))  # some parts spin too fast for 4 ms
    spec.option.integrator = int(rng.choice(_INTEGRATORS))
    floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    floor.friction[0], floor.condim = rng.uniform(0.0, 1.0), int(rng.choice([1, 3]))
    return spec


def _compiled(spec: mujoco.MjSpec, rng: np.random.Generator) -> Made:
    """Compile the scene; bodies that overlap at the start never collide, as is usual in models of robots."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    if data.ncon:
        for first, second in {tuple(sorted(pair)) for pair in model.geom_bodyid[data.contact.geom].tolist()}:
            spec.add_exclude(bodyname1=model.body(first).name, bodyname2=model.body(second).name)
        model = spec.compile()
        data = mujoco.MjData(model)
    data.qvel[:] = rng.normal(scale=0.5, size=model.nv)
    e = float(rng.uniform(0.0, 0.7))
    return Made(model, data, (MaximalDissipation(), Moreau(e), Newton(e))[rng.integers(3)])


def _tree(spec: mujoco.MjSpec, rng: np.random.Generator, where: np.ndarray, size: int) -> None:
    """Add a tree of `size` bodies; its root floats freely or is joined to the world."""
    name = f"tree{len(spec.bodies)}"
    root = spec.worldbody.add_body(name=name, pos=where, quat=_turn(rng))
    if rng.random() < 0.7:
        root.add_freejoint()
    else:
        _joint(spec, root, rng)
    _geom(root, rng)
    bodies = [(root, 0)]
    for i in range(size - 1):
        parent, depth = bodies[rng.integers(len(bodies))]
        body = parent.add_body(name=f"{name}-{i}", pos=0.2 * _unit(rng), quat=_turn(rng))
        _joint(spec, body, rng)
        _geom(body, rng)
        if depth + 1 < _DEPTH:
            bodies.append((body, depth + 1))


def _joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, rng: np.random.Generator) -> None:
    kind = int(rng.choice([_HINGE, _HINGE, _SLIDE, _BALL]))
    joint = body.add_joint(type=kind, axis=_unit(rng))
    if rng.random() < 0.5:  # RK4 is unstable if damping stops a joint within a timestep
        joint.damping[:] = rng.uniform(0.0, 1e-4 if spec.option.integrator == _RK4 else 0.1)
    if kind != _BALL and rng.random() < 0.5:
        width = 0.1 if kind == _SLIDE else 60.0  # m, or degrees for hinges
        joint.range[:], joint.limited = (-width * rng.uniform(0.2, 1), width * rng.uniform(0.2, 1)), 1


def _geom(body: mujoco.MjsBody, rng: np.random.Generator, largest: float = 0.1) -> None:
    size = rng.uniform(0.4 * largest, largest, 3)
    geom = body.add_geom(type=int(rng.choice(_SHAPES)), size=size, density=float(rng.choice([500.0, 1000.0, 2000.0])))
    geom.condim = int(rng.choice([1, 3, 3, 3, 4, 6]))
    geom.friction[:] = rng.uniform(0.0, 1.0), 0.005, 0.001


def _unit(rng: np.random.Generator) -> np.ndarray:
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def _turn(rng: np.random.Generator) -> np.ndarray:
    quat = rng.normal(size=4)
    return quat / np.linalg.norm(quat)
