"""Leave contacts out that a body passes, although their gradients say that they close.

Some open contacts are doubtful, and left out at first, see `fast_bodies` and `floor_edges`. If the resulting velocity
v+ closes them, the gap is measured where it leads, at ``q_M ⊕ h v+``, where the next step looks for contacts, and on
the way there. Only contacts of bodies that overlap there take part.
"""

from __future__ import annotations

import numpy as np

from impactlaw.scene.tolerances import APART
from impactlaw.solvers.cones.algebra.loops import cleared, kernel, plain, put
from impactlaw.solvers.cones.algebra.vectors import dot, minus
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.left_out.hidden_edges import moving_side
from impactlaw.stepping.time_stepping.problem.detection.carriers import carried, carry_on
from impactlaw.stepping.time_stepping.problem.detection.fast_bodies import thickness

_PASSED = 3e-6
"""Overlap, m, up to which a body passes over an edge."""
_LOOKS = 8
"""Largest number of places where a gap is measured."""


@plain
def _is_asked(k, address, doubtful, chosen, seen):
    """Return whether it is asked if a contact closes."""
    return doubtful[k] and seen[address[k]] and not chosen[address[k]]


@plain
def _rate(k, contacts, geometry, carriers, jacobian, velocity):
    """Return how fast a contact opens along its gradient, m/s."""
    (_, point, frame, geom, address), (nnz, adr, col, J), along = contacts, jacobian, 0.0
    for a in range(adr[address[k]], adr[address[k]] + nnz[address[k]]):
        along += J[a] * velocity[col[a]]
    one, other = carried(geom[k, 0], point[k], geometry, carriers), carried(geom[k, 1], point[k], geometry, carriers)
    return along + dot(frame[k], minus(other, one))


@plain
def _place(middle, carriers, place, time, at):
    """Move other data to where velocities lead within some time."""
    qpos, position, quaternion = place
    put(qpos, middle)
    carry_on(carriers, time, position, quaternion)
    mj.integrate_pos(at[0], at[2], at[3], time)
    mj.kinematics(at[0], at[1])


@kernel
def pass_over(
    contacts, geometry, extent, carriers, jacobian, velocity, timestep, middle, place, at, chosen, seen, doubtful
):  # fmt: skip
    """Take contacts out of those that a velocity closes if bodies pass them.

    Gaps are measured at least once while the body, or two that move, enter by half their thickness. Bodies that would
    enter by more than `_LOOKS` allow count as bodies that do not pass.

    Args:
        contacts: see `fast_bodies.leave_fast`, like the next one.
        geometry: properties of geoms and bodies.
        extent: MuJoCo's geom_aabb, (ngeom, 6).
        carriers: see `carriers.carried`.
        jacobian: see `rows.Source`.
        velocity: v+, (nv,).
        timestep: h, s.
        middle: q_M, (nq,).
        place: qpos, mocap_pos and mocap_quat of other data, written.
        at: addresses of the model, of these data, of their qpos and of ``velocity``.
        chosen: MuJoCo's rows that take part already, bool (nefc,).
        seen: rows that the velocity closes, bool (nefc,); written.
        doubtful: see `fast_bodies.leave_fast`.
    """
    (dist, _, _, geom, address), (_, body_of_geom, _, tree, _, _) = contacts, geometry
    hit, looks, many = cleared(len(dist)), 2, 0
    for k in range(len(dist)):
        if _is_asked(k, address, doubtful, chosen, seen):
            own, thin = moving_side(geom[k], body_of_geom, tree), 0.0
            for i in range(2):
                if own < 0 or i == own:
                    thin += thickness(geom[k, i], extent)
            way = timestep * _rate(k, contacts, geometry, carriers, jacobian, velocity)
            parts = np.ceil((-dist[k] - way) / thin)
            hit[k] = 2.0 * parts > _LOOKS
            if not hit[k]:
                many, looks = many + 1, max(looks, 2 * int(parts))
    for i in range(looks, 0, -1):
        if many > 0:
            _place(middle, carriers, place, i / looks * timestep, at)
            many = _hits(geom, address, at, chosen, seen, doubtful, hit)
    for k in range(len(dist)):
        if _is_asked(k, address, doubtful, chosen, seen) and not hit[k]:
            seen[address[k]] = False


@plain
def _hits(geom, address, at, chosen, seen, doubtful, hit):
    """Mark contacts whose bodies overlap in other data; return how many are not marked."""
    many, end, gap = 0, 0, 0.0
    while end < len(geom):
        first, asked = end, False
        while end < len(geom) and geom[end, 0] == geom[first, 0] and geom[end, 1] == geom[first, 1]:
            asked = asked or (not hit[end] and _is_asked(end, address, doubtful, chosen, seen))
            end += 1
        if asked:
            gap = mj.geom_distance(at[0], at[1], geom[first, 0], geom[first, 1], APART, 0)
        for k in range(first, end if asked else first):
            if _is_asked(k, address, doubtful, chosen, seen):
                hit[k] = hit[k] or gap < -_PASSED
                many += not hit[k]
    return many
