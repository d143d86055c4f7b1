"""MuJoCo's contacts, corrected: those of capsules and cylinders with planes where they consist of rounding errors.

Contact frames are made orthogonal, so that friction acts in the tangent plane. MuJoCo aligns the first tangent of a
contact between a capsule and a plane with the axis of the capsule. If the axis is the normal, this tangent consists of
rounding errors and has a normal part. Friction would then act like a normal impulse.

Distances of cylinders that stand on a plane are measured again. MuJoCo looks for the lowest point of the rim. If the
axis is tilted by an angle a from the normal, the height of that point has an error of some 1e-16 / a times the radius:
a cylinder at rest on its face would be lifted and dropped, and may have no contact at all.

Contacts with edges that a floor of several geoms hides are left out: bodies slide on over them.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled, for_python
from impactlaw.scene.tolerances import (
    ASKEW,
    ASKEW_SPHERE,
    FLUSH,
    ORTHOGONAL,
    OUT_OF_REACH,
    ROUNDED,
    STANDS,
    SUNK,
    TOUCHING,
    UPRIGHT,
)
from impactlaw.solvers.cones.algebra.loops import integers, kernel, plain

_PLANE, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}"))
    for name in ("PLANE", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
)


@plain
def _product(frame, k, i, j):
    return frame[k, i] * frame[k, j] + frame[k, i + 1] * frame[k, j + 1] + frame[k, i + 2] * frame[k, j + 2]


@plain
def is_orthogonal(frame, k):
    """Return whether the first tangent of contact k is in the tangent plane."""
    return abs(_product(frame, k, 0, 3)) <= ORTHOGONAL


@plain
def make_orthogonal(frame):
    """Replace the tangents of contacts whose first tangent is not in the tangent plane; return whether there are any.

    The new tangent is the projection of the old one onto the plane, if that is more than rounding.

    Args:
        frame: normals and two tangents each, (ncon, 9); tangents are written.
    """
    some = False
    for k in range(len(frame)):
        if is_orthogonal(frame, k):
            continue
        along, some, least = _product(frame, k, 0, 3), True, 0
        for i in range(3):
            frame[k, 3 + i] -= along * frame[k, i]
            least = i if abs(frame[k, i]) < abs(frame[k, least]) else least
        if _product(frame, k, 3, 3) < 0.25:
            for i in range(3):
                frame[k, 3 + i] = (1.0 if i == least else 0.0) - frame[k, least] * frame[k, i]
        length = np.sqrt(_product(frame, k, 3, 3))
        for i in range(3):
            frame[k, 3 + i] /= length
        for i in range(3):  # the second tangent is the vector product of the normal and the first
            a, b = (i + 1) % 3, (i + 2) % 3
            frame[k, 6 + i] = frame[k, a] * frame[k, 3 + b] - frame[k, b] * frame[k, 3 + a]
    return some


straighten = for_python(make_orthogonal)
"""The form of `make_orthogonal` that Python calls."""


@plain
def measure_standing(kind, size, place, turn, geom, dist, pos, frame):
    """Measure again the gaps of cylinders that stand on planes, at the points of their rims; move the points halfway.

    Return whether any gap changes.

    Args:
        kind: types of geoms, (ngeom,).
        size: their sizes, m, (ngeom, 3).
        place: their positions, m, (ngeom, 3).
        turn: their rotation matrices, (ngeom, 9).
        geom: geoms of contacts, the plane first, (ncon, 2).
        dist: gaps, m, (ncon,); written.
        pos: contact points, m, (ncon, 3); written.
        frame: frames with normals first, at least (ncon, 3).
    """
    changed = False
    for k in range(len(dist)):
        plane, own = geom[k, 0], geom[k, 1]
        if plane < 0 or own < 0 or kind[plane] != _PLANE or kind[own] != _CYLINDER:
            continue
        cosine, along, out = 0.0, 0.0, 0.0
        for i in range(3):
            cosine += turn[own, 3 * i + 2] * frame[k, i]
            along += turn[own, 3 * i + 2] * (pos[k, i] - place[own, i])
        if abs(cosine) < STANDS:
            continue
        for i in range(3):
            out += (pos[k, i] - place[own, i] - along * turn[own, 3 * i + 2]) ** 2
        scale, end, gap = size[own, 0] / np.sqrt(out), np.sign(along) * size[own, 1], 0.0
        end -= scale * along
        for i in range(3):
            point = place[own, i] + end * turn[own, 3 * i + 2] + scale * (pos[k, i] - place[own, i])
            gap += (point - place[plane, i]) * frame[k, i]
        if abs(gap - dist[k]) <= ROUNDED:
            continue
        changed, dist[k] = True, gap
        for i in range(3):
            point = place[own, i] + end * turn[own, 3 * i + 2] + scale * (pos[k, i] - place[own, i])
            pos[k, i] = point - 0.5 * gap * frame[k, i]
    return changed


measure_again = for_python(measure_standing)
"""The form of `measure_standing` that Python calls."""


@plain
def support(kind, size, normal):
    """Return how far a shape extends from its center along a normal in its frame, m; infinite if not in closed form."""
    x, y, z = abs(normal[0]), abs(normal[1]), abs(normal[2])
    if kind == _SPHERE:
        return size[0]
    if kind == _CAPSULE:
        return size[0] + size[1] * z
    if kind == _ELLIPSOID:
        return np.sqrt((size[0] * x) ** 2 + (size[1] * y) ** 2 + (size[2] * z) ** 2)
    if kind == _CYLINDER:
        return size[0] * np.sqrt(x * x + y * y) + size[1] * z
    if kind == _BOX:
        return size[0] * x + size[1] * y + size[2] * z
    return np.inf


@plain
def _beyond(g, point, normal, sign, shapes):
    """Return how far a geom extends beyond a point along a normal times `sign`, m."""
    shape, extent, place, turn = shapes
    far, own = 0.0, (0.0, 0.0, 0.0)
    for i in range(3):
        n = normal[i]
        far += sign * n * (place[g, i] - point[i])
        own = (own[0] + n * turn[g, 3 * i], own[1] + n * turn[g, 3 * i + 1], own[2] + n * turn[g, 3 * i + 2])
    return far + support(shape[g], extent[g], own)


@plain
def _mover(pair, body_of_geom, tree):
    """Return the place of the moving geom in a contact with a fixed one, -1 for other contacts."""
    if pair[0] < 0 or pair[1] < 0:
        return -1
    first, second = tree[body_of_geom[pair[0]]] >= 0, tree[body_of_geom[pair[1]]] >= 0
    return int(second) if first != second else -1


@kernel
def hide_edges(dist, pos, frame, geom, body_of_geom, weld, tree, shapes):
    """Put contacts out of reach that the plane of a closed contact hides; return whether there are any.

    A body that slides over a floor of several geoms comes near the edge of the one ahead. That contact closes along the
    floor, but the body passes over it: no part of the geom ahead is above the floor, and no part of the body is lower
    than it has sunk into the floor.

    Args:
        dist: gaps, m, (ncon,); written.
        pos: contact points, m, (ncon, 3).
        frame: frames with normals first, at least (ncon, 3).
        geom: geoms of contacts, (ncon, 2).
        body_of_geom: body of each geom, (ngeom,).
        weld: MuJoCo's body_weldid, (nbody,).
        tree: MuJoCo's body_treeid, -1 for bodies without degrees of freedom, (nbody,).
        shapes: MuJoCo's geom_type, geom_size, geom_xpos and geom_xmat.
    """
    last, before, hidden = integers(len(body_of_geom)), integers(len(dist)), False
    last[:] = -1  # the last contact of each moving geom with fixed ones, and the one before each contact
    for k in range(len(dist)):
        own = _mover(geom[k], body_of_geom, tree)
        if own >= 0:
            before[k], last[geom[k, own]] = last[geom[k, own]], k
    for s in range(len(dist)):
        own = -1 if dist[s] > TOUCHING else _mover(geom[s], body_of_geom, tree)
        if own < 0:
            continue
        mover, floor, up = geom[s, own], geom[s, 1 - own], 2.0 * own - 1.0
        least, k = ASKEW_SPHERE if shapes[0][mover] == _SPHERE else ASKEW, last[mover]
        while k >= 0:
            if _hides(s, k, floor, mover, up, least, dist, pos, frame, geom, body_of_geom, weld, shapes):
                dist[k], hidden = OUT_OF_REACH, True
            k = before[k]
    return hidden


@plain
def _hides(s, k, floor, mover, up, least, dist, pos, frame, geom, body_of_geom, weld, shapes):
    """Return whether contact s with the floor hides contact k of the same geom with the geom ahead."""
    ahead, sign = (geom[k, 1], -up) if geom[k, 0] == mover else (geom[k, 0], up)
    if ahead == floor or weld[body_of_geom[ahead]] != weld[body_of_geom[floor]]:
        return False
    along = 0.0
    for i in range(3):
        along += sign * frame[k, i] * frame[s, i]
    if along > least or _beyond(ahead, pos[s], frame[s], up, shapes) + 0.5 * dist[s] > FLUSH:
        return False
    return _beyond(mover, pos[s], frame[s], -up, shapes) - 0.5 * dist[s] <= FLUSH + SUNK * max(0.0, -dist[s])


@plain
def upright(turn, plane, own, least):
    """Return 1 if a cylinder's axis is the normal of a plane, -1 if it is the opposite, 0 if the cylinder is tilted.

    It counts as tilted from a tilt whose sine is ``least``.
    """
    cosine, tilt = 0.0, 0.0
    for i in range(3):
        cosine += turn[plane, 3 * i + 2] * turn[own, 3 * i + 2]
    for i in range(3):
        tilt += (turn[own, 3 * i + 2] - cosine * turn[plane, 3 * i + 2]) ** 2
    return np.sign(cosine) if tilt < least * least else 0.0


@compiled()
def _align(planes, cylinders, turn):
    """Turn the axes of cylinders into the normal of a plane if the angle between them is no more than rounding."""
    for plane in planes:
        for own in cylinders:
            sign = upright(turn, plane, own, UPRIGHT)
            for i in range(3 if sign != 0.0 else 0):
                turn[own, 3 * i + 2] = sign * turn[plane, 3 * i + 2]


class StandingCylinders:
    """Corrects MuJoCo's contacts of cylinders that stand on planes."""

    def __init__(self, model: mujoco.MjModel, planes: np.ndarray, cylinders: np.ndarray):
        self._model, self._planes, self._cylinders = model, planes, cylinders
        self._masks: tuple[bytes, bytes] | None = None
        self._can_meet = False

    def can_meet(self) -> bool:
        """Return whether a cylinder and a plane can meet now; most of those in pictures cannot."""
        model = self._model
        masks = model.geom_contype.tobytes(), model.geom_conaffinity.tobytes()
        if masks != self._masks:
            planes, own, kind, affinity = self._planes, self._cylinders, model.geom_contype, model.geom_conaffinity
            meet = (kind[planes][:, None] & affinity[own]) | (affinity[planes][:, None] & kind[own])
            chosen = np.isin(model.pair_geom1, own) | np.isin(model.pair_geom2, own)
            self._masks, self._can_meet = masks, bool(meet.any() or chosen.any())
        return self._can_meet

    def align(self, data: mujoco.MjData) -> None:
        """Change rotation matrices so that MuJoCo finds the contacts of cylinders that stand upright."""
        _align(self._planes, self._cylinders, data.geom_xmat)

    def measure(self, data: mujoco.MjData) -> None:
        """Call `measure_standing` from Python."""
        if data.ncon:
            model, found = self._model, data.contact
            places = data.geom_xpos, data.geom_xmat
            measure_again(model.geom_type, model.geom_size, *places, found.geom, found.dist, found.pos, found.frame)
