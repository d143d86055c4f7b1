"""Convert a model's geoms to rerun archetypes: one group per kind of primitive, drawn by one entity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from impactlaw.recording.layout import SCENE
from impactlaw.scene.contacts import geom_names

_PRIMITIVES = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_NO_RGBA = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)  # MuJoCo's default: the material's color is shown
_INFINITE = 5.0  # half side of an infinite plane, in extents of the model


@dataclass(frozen=True, eq=False)
class Group:
    """Geoms drawn by one entity, each placed by the pose of its body."""

    path: str  # path of the entity
    bodies: np.ndarray  # body id of each geom
    archetype: Any  # rerun's archetype, in the frames of the bodies
    fixed: bool  # whether the bodies never move


def read_geometry(model: mujoco.MjModel) -> list[Group]:
    """Return the geoms that MuJoCo shows by default (visible groups, not fully transparent), grouped for drawing."""
    shown = np.array(mujoco.MjvOption().geomgroup, dtype=bool)
    visible = shown[np.clip(model.geom_group, 0, len(shown) - 1)] & (colors(model)[:, 3] > 0)
    moving = model.body_weldid[model.geom_bodyid] != 0
    groups = []
    for kind, name in enumerate(_PRIMITIVES):
        for fixed in (True, False):
            geoms = np.flatnonzero(visible & (model.geom_type == kind) & (moving != fixed))
            path = f"{SCENE}/fixed/{name}" if fixed else f"{SCENE}/{name}"
            if name in ("hfield", "mesh", "sdf"):  # rerun has one mesh per entity
                parts = [(f"{path}/{same[0]}", same, _surface(model, same[0])) for same in _alike(model, geoms)]
            else:
                parts = [(path, geoms, _primitives(model, name, geoms))] if len(geoms) else []
            groups += [Group(path, model.geom_bodyid[ids], archetype, fixed) for path, ids, archetype in parts]
    return groups


def colors(model: mujoco.MjModel) -> np.ndarray:
    """Return the color of each geom as MuJoCo shows it, RGBA in 0..255: its own or its material's."""
    rgba = np.array(model.geom_rgba)
    material = model.geom_matid
    from_material = (material >= 0) & (rgba == _NO_RGBA).all(axis=1)
    rgba[from_material] = model.mat_rgba[material[from_material]]
    return np.rint(255 * np.clip(rgba, 0, 1)).astype(np.uint8)


def body_names(model: mujoco.MjModel) -> list[str]:
    """Return a unique name of each body: its own, or ``body<id>``, with "_" appended while another body has it."""
    given, names = {model.body(i).name for i in range(model.nbody)}, []
    for i in range(model.nbody):
        name = f"body{i}"
        while name in given:
            name += "_"
        names.append(model.body(i).name or name)
    return names


def _primitives(model: mujoco.MjModel, kind: str, geoms: np.ndarray) -> Any:
    import rerun as rr

    names, size, center = geom_names(model), model.geom_size[geoms], model.geom_pos[geoms]
    axis = np.array([_rotation(model.geom_quat[geom])[:, 2] for geom in geoms])
    style: dict[str, Any] = {
        "quaternions": model.geom_quat[geoms][:, [1, 2, 3, 0]],
        "colors": colors(model)[geoms],
        "fill_mode": rr.components.FillMode.Solid,
        "labels": [names[geom] for geom in geoms],
        "show_labels": False,
    }
    radius, half = size[:, 0], size[:, 1]
    match kind:
        case "sphere":
            return rr.Ellipsoids3D(half_sizes=np.repeat(radius[:, None], 3, axis=1), centers=center, **style)
        case "ellipsoid":
            return rr.Ellipsoids3D(half_sizes=size, centers=center, **style)
        case "capsule":  # rerun's capsule begins at its origin
            return rr.Capsules3D(lengths=2 * half, radii=radius, translations=center - half[:, None] * axis, **style)
        case "cylinder":
            return rr.Cylinders3D(lengths=2 * half, radii=radius, centers=center, **style)
        case "box":
            return rr.Boxes3D(half_sizes=size, centers=center, **style)
        case _:  # a plane is drawn as a thin slab below it
            sides = np.where(size[:, :2] > 0, size[:, :2], _INFINITE * model.stat.extent)
            thickness = 1e-3 * model.stat.extent
            half_sizes = np.column_stack([sides, np.full(len(geoms), thickness)])
            return rr.Boxes3D(half_sizes=half_sizes, centers=center - thickness * axis, **style)


def _alike(model: mujoco.MjModel, geoms: np.ndarray) -> list[np.ndarray]:
    """Return the geoms in groups that look the same in the frames of their bodies, so that one mesh draws them all."""
    looks = np.column_stack([model.geom_dataid, colors(model), model.geom_pos, model.geom_quat])[geoms]
    groups: dict[bytes, list[int]] = {}
    for geom, look in zip(geoms.tolist(), looks, strict=True):
        groups.setdefault(look.tobytes(), []).append(geom)
    return [np.array(same) for same in groups.values()]


def _surface(model: mujoco.MjModel, geom: int) -> Any:
    import rerun as rr

    is_field = int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_HFIELD)
    vertices, normals, triangles = (_height_field if is_field else _mesh)(model, int(model.geom_dataid[geom]))
    rotation = _rotation(model.geom_quat[geom])
    return rr.Mesh3D(
        vertex_positions=vertices @ rotation.T + model.geom_pos[geom],
        vertex_normals=normals @ rotation.T,
        triangle_indices=triangles,
        albedo_factor=colors(model)[geom],
    )


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, each with one of the normals with which MuJoCo shades it, and the triangles between them."""
    start, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    corners = model.mesh_face[start : start + count].ravel() + model.mesh_vertadr[mesh]
    normals = model.mesh_facenormal[start : start + count].ravel() + model.mesh_normaladr[mesh]
    pairs, triangles = np.unique(corners * np.int64(model.nmeshnormal) + normals, return_inverse=True)
    vertex, normal = np.divmod(pairs, model.nmeshnormal)
    return model.mesh_vert[vertex], model.mesh_normal[normal], triangles.reshape(-1, 3)


def _height_field(model: mujoco.MjModel, field: int) -> tuple[np.ndarray, np.ndarray, None]:
    """Return the corners of all triangles in sequence, and flat normals, which triangles do not share."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    half_x, half_y, top, _ = model.hfield_size[field]
    start = model.hfield_adr[field]
    height = top * model.hfield_data[start : start + rows * columns].reshape(rows, columns)
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    point = np.stack([x, y, height], axis=-1)
    a, b, c, d = (part.reshape(-1, 3) for part in (point[:-1, :-1], point[:-1, 1:], point[1:, 1:], point[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return triangles.reshape(-1, 3), np.repeat(normals, 3, axis=0), None


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
