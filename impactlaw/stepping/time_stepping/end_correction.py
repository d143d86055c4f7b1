"""Correction at the end of a step: contacts of fast-turning bodies deviate from the gradients at the midpoint."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import compiled
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import plain
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.problem.overlaps import open_overlaps
from impactlaw.stepping.time_stepping.problem.reader import RowReader, read_rows
from impactlaw.stepping.time_stepping.problem.rows import Rows
from impactlaw.stepping.time_stepping.standing_cylinders import CYLINDER, PLANE, find_standing
from impactlaw.stepping.time_stepping.temporary_options import TemporaryOptions

_SEEN = 3e-6
"""Smallest depth, m, that requires a correction."""
_DEEP = 1e-4
"""Depth, m or rad, beyond which an overlap is opened over time."""

SLOP = 1e-8
"""Depth, m or rad, that is left uncorrected."""
BEYOND = 4.0
"""Range, as a multiple of the depth, within which opening some contacts can close others."""
_EDGES = tuple(int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("HFIELD", "CYLINDER", "BOX", "MESH"))
"""Shapes with edges."""
_SPHERE, _CAPSULE, _ELLIPSOID, _BOX = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("SPHERE", "CAPSULE", "ELLIPSOID", "BOX")
)
LAST_LOSS = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)


@plain
def _turning(velocity, body):
    """Return the square of the angular velocity of a body, rad^2/s^2, from MuJoCo's cvel."""
    return velocity[body, 0] ** 2 + velocity[body, 1] ** 2 + velocity[body, 2] ** 2


@plain
def _slides(velocity, body, up):
    """Return how fast a body slides along its parent, m/s; 0 if it also turns relative to it."""
    square = 0.0
    for k in range(3):
        if velocity[body, k] != velocity[up, k]:
            return 0.0
        square += (velocity[body, k + 3] - velocity[up, k + 3]) ** 2  # both at the same point
    return np.sqrt(square)


@plain
def _acceleration(body, velocity, size, center, offset, parent):
    """Return a bound on the acceleration of points of a body at constant joint velocities, m/s^2.

    It is ``w^2`` times the length of links, and ``2 w v`` for a link that slides along another one that turns.
    """
    turning = _turning(velocity, body)
    most = turning * size[body]
    while body > 0:
        up, below, length = parent[body], turning, 0.0
        turning = _turning(velocity, up)
        most += 2.0 * np.sqrt(turning) * _slides(velocity, body, up)
        for k in range(3):
            length += (center[body, k] - center[up, k]) ** 2 if up > 0 else offset[body, k] ** 2
        most += max(turning, below) * np.sqrt(length)
        body = up
    return most


@plain
def _arm(shapes, sizes):
    """Return the distance from a body's centre of a contact that can jump between edges of two shapes, m.

    Return -1 if it cannot jump.
    """
    if shapes[0] in _EDGES and shapes[1] in _EDGES:
        return min(sizes)
    if shapes == (PLANE, CYLINDER) or shapes == (CYLINDER, PLANE):  # the contact runs round the rim
        return max(sizes)
    return -1.0


@plain
def _sliding(one, other, velocity, arm, rates, first, many):
    """Return how fast two bodies slide along each other where a contact can be, m/s."""
    along = turning = 0.0
    for k in range(first + 1, first + min(many, 3)):
        along += rates[2, k] ** 2
    for k in range(3):
        turning += (velocity[one, k] - velocity[other, k]) ** 2
    return np.sqrt(along) + np.sqrt(turning) * arm


@plain
def _support(kind, size, normal):
    """Return how far a shape extends from its centre along a normal in its frame, m; infinite if not in closed form."""
    x, y, z = abs(normal[0]), abs(normal[1]), abs(normal[2])
    if kind == _SPHERE:
        return size[0]
    if kind == _CAPSULE:
        return size[0] + size[1] * z
    if kind == _ELLIPSOID:
        return np.sqrt((size[0] * x) ** 2 + (size[1] * y) ** 2 + (size[2] * z) ** 2)
    if kind == CYLINDER:
        return size[0] * np.sqrt(x * x + y * y) + size[1] * z
    if kind == _BOX:
        return size[0] * x + size[1] * y + size[2] * z
    return np.inf


@plain
def _plane_gap(one, other, shape, extent, place, turn):
    """Return the gap between a plane and another geom, m; minus infinity if it is not known in closed form."""
    if shape[one] != PLANE:
        one, other = other, one
    if shape[one] != PLANE:
        return -np.inf
    gap, normal = 0.0, (0.0, 0.0, 0.0)
    for k in range(3):
        n = turn[one, 3 * k + 2]
        gap += n * (place[other, k] - place[one, k])
        x, y, z = turn[other, 3 * k], turn[other, 3 * k + 1], turn[other, 3 * k + 2]
        normal = (normal[0] + n * x, normal[1] + n * y, normal[2] + n * z)
    return gap - _support(shape[other], extent[other], normal)


@compiled(
    "(int32[:,::1],float64[:,::1],float64[:,::1],int32[:,::1],int32[::1],int32[::1],float64[:,::1],float64[:,::1],"
    "float64[:,::1],float64[:,::1],float64[::1],float64[:,::1],float64[:,::1],int32[::1],float64)"
)
def bend(
    groups, amounts, rates, geoms, body_of_geom, shape, extent, place, turned, velocity, size, center, offset, parent,
    timestep,
):  # fmt: skip
    """Return a bound on the deviation of contacts from their gradients at the end of a step, m; 0 if below `_SEEN`.

    A point with acceleration a at constant joint velocities leaves its straight line by ``a (h / 2)^2 / 2``. Between
    two shapes with edges a contact can also jump from one edge to another, as far as the bodies slide along each other.
    On a plane it can run round the rim of a cylinder. Gaps to planes that are known in closed form need no bound; those
    that are deep are opened over time.

    Args:
        groups: see `rows.Rows`, like the next two.
        amounts: gaps first.
        rates: ``J v_free`` third.
        geoms: geoms of MuJoCo's contacts, (ncon, 2).
        body_of_geom: body of each geom, (ngeom,).
        shape: MuJoCo's geom_type of each geom, (ngeom,).
        extent: MuJoCo's geom_size, (ngeom, 3).
        place: positions of geoms at the end of the step, MuJoCo's geom_xpos, (ngeom, 3).
        turned: their frames, MuJoCo's geom_xmat, (ngeom, 9).
        velocity: MuJoCo's cvel at the end of the step, (nbody, 6).
        size: result of `margins.write_sizes`, (nbody,).
        center: centers of mass of bodies, (nbody, 3).
        offset: centers of mass relative to the frames of bodies, (nbody, 3).
        parent: parent of each body, (nbody,).
        timestep: h, s.
    """
    most = 0.0
    for g in range(groups.shape[1]):
        source = groups[3, g]
        if source < 0:
            continue
        one, other = geoms[source, 0], geoms[source, 1]
        gap = _plane_gap(one, other, shape, extent, place, turned)
        if gap >= -SLOP:
            continue
        turn, bodies = 0.0, (body_of_geom[one], body_of_geom[other])
        for body in bodies:
            turn += 0.125 * timestep**2 * _acceleration(body, velocity, size, center, offset, parent)
        arm = _arm((shape[one], shape[other]), (size[bodies[0]], size[bodies[1]]))
        if arm >= 0.0:
            turn += 0.5 * timestep * _sliding(*bodies, velocity, arm, rates, groups[0, g], groups[1, g])
        if gap > -_DEEP:
            turn = max(turn, -gap)
        elif amounts[0, g] + timestep * min(rates[2, groups[0, g]], 0.0) >= turn:
            continue
        if turn > _SEEN:
            most = max(most, turn)
    return most


@compiled()
def end_targets(groups, key, amounts, depth, before_key, before, timestep):
    """Return how fast positions must move to open overlaps, m/s, (g,), and whether any must.

    Overlaps that have existed since the start of the step are opened by at most a depth, m, other overlaps completely.

    Args:
        groups: see `rows.Rows`, like the next two.
        key: keys of groups.
        amounts: gaps first.
        depth: largest opening of old overlaps, m.
        before_key: keys of the groups of the step, (k,).
        before: their gaps at the start of the step, m or rad, (k,).
        timestep: h, s.
    """
    need, some = np.zeros(groups.shape[1]), False
    for g in range(len(need)):
        if groups[2, g] != CONE:
            continue
        gap = amounts[0, g]
        need[g] = -gap / timestep
        if gap < -SLOP:
            some = True
            for k in range(len(before)):
                if before_key[k] == key[g] and before[k] < -_DEEP:
                    need[g] = min(-gap, depth) / timestep
    return need, some


class EndCorrection:
    """Finds overlaps at the end of a step, and the shift of positions that opens them."""

    def __init__(self, model: mujoco.MjModel, size: np.ndarray, options: TemporaryOptions, reader: RowReader):
        self._model, self._size, self._options, self._reader = model, size, options, reader
        self._scratch: mujoco.MjData | None = None

    def shift(self, data: mujoco.MjData, rows: Rows, geoms: np.ndarray, metric: Inertia) -> np.ndarray | None:
        """Return the velocity, (nv,), that opens the overlaps of data within one timestep; None if there are none.

        Args:
            data: state and frames at the end of the step.
            rows: the rows of the step.
            geoms: geoms of the contacts that these rows belong to, (ncon, 2).
            metric: the mass matrix of the step.
        """
        model, h = self._model, self._model.opt.timestep
        depth = bend(
            rows.groups, rows.amounts, rows.rates, geoms, model.geom_bodyid, model.geom_type, model.geom_size,
            data.geom_xpos, data.geom_xmat, data.cvel, self._size, data.xipos, model.body_ipos, model.body_parentid, h,
        )  # fmt: skip
        if depth == 0.0:
            return None
        self._options.tighten_margins(BEYOND * depth)
        now, nothing = self._look(data), np.zeros(model.nv)
        if not np.any(now.contact.dist < -SLOP):
            return None
        mujoco.mj_comPos(model, now)
        if model.ntendon:
            mujoco.mj_tendon(model, now)
        mujoco.mj_makeConstraint(model, now)
        near = self._reader.without_tied(now, (now.efc_type <= LAST_LOSS) | (now.efc_pos < BEYOND * depth))
        seen = read_rows(model, now, metric, nothing, nothing, near, belts=False)
        started = rows.gap - 0.5 * h * rows.before[rows.first]
        need, some = end_targets(seen.groups, seen.key, seen.amounts, depth, rows.key, started, h)
        if not some:
            return None
        return open_overlaps(seen, need, h, metric)

    def _look(self, data: mujoco.MjData) -> mujoco.MjData:
        """Return data with the current contacts."""
        model = self._model
        if self._scratch is None:
            self._scratch = mujoco.MjData(model)
        now = self._scratch
        now.qpos[:], now.eq_active[:] = data.qpos, data.eq_active
        now.mocap_pos[:], now.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        mujoco.mj_kinematics(model, now)
        if self._options.stands:
            find_standing(model, now)
        else:
            mujoco.mj_collision(model, now)
        return now
