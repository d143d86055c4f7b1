"""Contacts of cylinders that stand on planes, where MuJoCo's consist of rounding errors.

MuJoCo looks for the lowest point of the rim, and adds two points such that the three are corners of a triangle. If the
axis is the normal up to rounding, that point is arbitrary, its distance is wrong by up to the radius, and contacts may
be missing. Contacts are then found for the axis turned into the normal, and their gaps are measured at the true axis,
see `scene.corrected.rounding.measure_standing`.

The three points hold a cylinder up to its rim only in the direction of the first. It is therefore put to where
gravity and the velocity tip the cylinder: otherwise a cylinder that can stand would roll over the edge of the triangle.
"""

from __future__ import annotations

import mujoco

from impactlaw.linked import linked
from impactlaw.scene.corrected.rounding import measure_standing, upright
from impactlaw.solvers.cones.algebra.loops import numbers, plain, put
from impactlaw.solvers.cones.algebra.vectors import across, axis_of, cross, dot, minus, plus, row, times, unit
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import (
    contacts_of,
    data_floats,
    model_floats,
    model_ints,
    number,
    offset,
    shapes_of,
    size,
)
from impactlaw.stepping.compiled.fields import DATA, MODEL, floats, keep
from impactlaw.stepping.time_stepping.compiled.detection.carriers import carried, carrier_of
from impactlaw.stepping.time_stepping.compiled.state.kinds import BOOLEAN, WORLD
from impactlaw.stepping.time_stepping.compiled.state.surfaces import ROW, velocities_of
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting

PLANE, CYLINDER = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_FLAT = 1e-7  # m: difference of heights around the rim of an upright cylinder
_SLOW = 1e-9  # m/s: speed up to which a velocity has no direction
_WEAK = 1e-9  # m/s^2: gravity along the plane up to which it has no direction


@plain
def _tip(w, plane, own):
    """Return the direction in a plane, of length 1, in which a cylinder that stands on it tends to tip.

    The force that would stop the cylinder acts in this direction from its axis.
    """
    n, (_, size_of, place, turn), surface = size(w, MODEL.nbody), shapes_of(w), velocities_of(w, ROW.end)
    velocity, subtree = data_floats(w, DATA.cvel, (n, 6)), data_floats(w, DATA.subtree_com, (n, 3))
    b, gravity = model_ints(w, MODEL.geom_bodyid, len(turn))[own], floats(w.model + offset(w, MODEL.opt_gravity), 3)
    lever, square = size_of[own, 1], 0.25 * size_of[own, 0] ** 2 + size_of[own, 1] ** 2 / 3.0
    normal, center, spin = axis_of(turn, plane, 2), row(place, own), row(velocity, b)
    arm = minus(center, row(subtree, model_ints(w, MODEL.body_rootid, n)[b]))
    along, under = plus(velocity[b, 3:], 1.0, cross(spin, arm)), carrier_of(w, plane)
    if under >= 0 and len(surface) > 0:
        along = minus(along, carried(w, under, center, ROW.end))
        spin = minus(spin, surface[under, 3:])
    way = across(plus(times(lever, along), square, cross(spin, normal)), normal)
    if not dot(way, way) > (_SLOW * lever) ** 2:
        way = across(gravity, normal)
        if not dot(way, way) > _WEAK**2:
            way = across(axis_of(turn, own, 0), normal)
    return unit(way)


@plain
def _is_near(w, plane, own):
    """Return whether the lower face is within the margins of contact."""
    _, size_of, place, turn = shapes_of(w)
    margin = model_floats(w, MODEL.geom_margin, len(turn))
    height = dot(minus(row(place, own), row(place, plane)), axis_of(turn, plane, 2)) - size_of[own, 1]
    far = margin[plane] + margin[own]
    for each in model_floats(w, MODEL.pair_margin, size(w, MODEL.npair)):
        far = max(far, each)
    return height <= far


@plain
def _make_upright(w, kept):
    """Turn cylinders near planes upright that are so up to rounding; return whether there are any.

    If so, the rotation matrices of geoms as they were are written, (9 ngeom,).
    """
    some, (kind, size_of, _, turn) = False, shapes_of(w)
    for plane in range(len(kind)):
        for own in range(len(kind) if kind[plane] == PLANE else 0):
            if kind[own] != CYLINDER:
                continue
            sign = upright(turn, plane, own, _FLAT / size_of[own, 0])
            if sign == 0.0 or not _is_near(w, plane, own):
                continue
            if not some:
                some = True
                put(kept, data_floats(w, DATA.geom_xmat, len(kept)))
            to, normal = _tip(w, plane, own), times(sign, axis_of(turn, plane, 2))
            second = cross(normal, to)
            for i in range(3):
                turn[own, 3 * i], turn[own, 3 * i + 1], turn[own, 3 * i + 2] = to[i], second[i], normal[i]
    return some


@linked(BOOLEAN(WORLD, BOOLEAN))
def find_standing(w, found):
    """Find contacts, and measure the gaps of cylinders that stand on planes again; return whether any has changed.

    Args:
        w: the world with current frames of geoms.
        found: whether MuJoCo has found the contacts of this state already.
    """
    if setting(w, SETTING.stands) == 0.0:
        if not found:
            mj.collision(w.model, w.data)
        return False
    room = numbers(9 * size(w, MODEL.ngeom))
    changed = _make_upright(w, room)
    if changed or not found:
        mj.collision(w.model, w.data)
    if changed:
        put(data_floats(w, DATA.geom_xmat, len(room)), room)
    if number(w, DATA.ncon) > 0:
        dist, pos, frame, geom = contacts_of(w)
        changed = measure_standing(*shapes_of(w), geom, dist, pos, frame) or changed
    keep(room)
    return changed
