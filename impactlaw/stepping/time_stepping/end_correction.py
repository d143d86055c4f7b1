"""Correction at the end of a step: contacts of fast-turning bodies deviate from the gradients at the midpoint."""

from __future__ import annotations

from functools import cached_property, partial

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.scene.corrected.side_by_side import line_gap
from impactlaw.scene.tolerances import APART
from impactlaw.solvers.cones import CONE
from impactlaw.solvers.cones.algebra.loops import kernel, plain
from impactlaw.solvers.cones.algebra.vectors import axis_of, cross, dot, length, minus, plus, row
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.left_out.hidden_edges import support
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.free_motion import update_frames
from impactlaw.stepping.time_stepping.problem.detection.far_contacts import jump_speed
from impactlaw.stepping.time_stepping.problem.detection.nearest_points import find_nearest
from impactlaw.stepping.time_stepping.problem.overlaps import COUNTED, begins_deep, open_overlaps
from impactlaw.stepping.time_stepping.problem.reader import RowReader, read_rows
from impactlaw.stepping.time_stepping.problem.rows import Known, Rows
from impactlaw.stepping.time_stepping.standing_cylinders import PLANE, find_standing
from impactlaw.stepping.time_stepping.temporary_options import TemporaryOptions

_SEEN = 3e-6
"""Smallest depth, m, that requires a correction."""
_DEEP = 1e-4
"""Depth, m or rad, beyond which an overlap is opened over time."""

SLOP = 1e-8
"""Depth, m or rad, that is left uncorrected."""
BEYOND = 4.0
"""Range, as a multiple of the depth, within which opening some contacts can close others."""
CLOSE = 1e-5
"""Least range of this search, m: within less, MuJoCo finds hulls that just touch centimeters deep in each other."""
_SDF = int(mujoco.mjtGeom.mjGEOM_SDF)
ROUNDS = 3
"""Largest number of corrections in a step: where a contact jumps, one does not open all of an overlap."""
LITTLE = 0.5
"""Part of the depth before a correction that may remain if there is to be another one."""
LAST_LOSS = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)


@plain
def _acceleration(i, motion):
    """Return a bound on the acceleration of points of a body at constant joint velocities, m/s^2."""
    velocity, rate, qvel, parent, first, many, center, subtree, root, size = motion
    turned, moved, body = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), i  # rate of change of MuJoCo's cvel
    while body > 0:
        for j in range(first[body], first[body] + many[body]):
            turned, moved = plus(turned, qvel[j], rate[j]), plus(moved, qvel[j], rate[j, 3:])
        body = parent[body]
    spin, arm = row(velocity, i), minus(row(center, i), row(subtree, root[i]))
    v = plus(velocity[i, 3:], 1.0, cross(spin, arm))
    moved = plus(plus(moved, 1.0, cross(turned, arm)), 1.0, cross(spin, v))
    return length(moved) + (length(turned) + dot(spin, spin)) * size[i]


@plain
def _plane_gap(one, other, shape, extent, place, turn):
    """Return the gap between a plane and another geom, m; minus infinity if it is not known in closed form."""
    if shape[one] != PLANE:
        one, other = other, one
    if shape[one] != PLANE:
        return -np.inf
    normal = axis_of(turn, one, 2)
    x, y, z = axis_of(turn, other, 0), axis_of(turn, other, 1), axis_of(turn, other, 2)
    own = dot(x, normal), dot(y, normal), dot(z, normal)
    gap = dot(normal, minus(row(place, other), row(place, one)))
    return gap - support(shape[other], extent[other], own)


@plain
def _foresee(first, end, g, gaps, rows, timestep):
    """Return what gradients say of the contacts of two geoms.

    This is the least gap at the end of the step, m, how fast contacts slide, m/s, and whether any was deep before it.

    Args:
        first: index of the first contact.
        end: index behind the last contact.
        g: the first group whose source is one of these contacts or a later one.
        gaps: gaps in the middle of the step, m. Contacts without a group would not close within two steps, unless they
            are closed and have no effect.
        rows: groups, amounts and rates, see `rows.Rows`.
        timestep: h, s.
    """
    (groups, amounts, rates), least, sliding, old = rows, np.inf, 0.0, False
    for c in range(first, end):
        while g < groups.shape[1] and groups[3, g] < c:
            g += 1
        if g == groups.shape[1] or groups[3, g] > c:
            least = min(least, 0.5 * gaps[c] if gaps[c] > 0.0 else np.inf)
            continue
        row, along = groups[0, g], 0.0
        for k in range(row + 1, row + min(groups[1, g], 3)):
            along += rates[2, k] ** 2
        least, sliding = min(least, amounts[0, g] + timestep * min(rates[2, row], 0.0)), max(sliding, np.sqrt(along))
        old = old or amounts[0, g] - 0.5 * timestep * rates[1, row] < -_DEEP
    return least, sliding, old


@plain
def bend(contacts, rows, geometry, motion, mocap, surface_speed, at, timestep, again):
    """Return the depth of the deepest overlap at the end of a step, m, and how far to open those of the start, m.

    Both are 0 if no overlap asks for a correction. Overlaps arise because contacts deviate from their gradients. A
    point with acceleration a at constant joint velocities leaves its straight line by ``a (h / 2)^2 / 2``, and a
    contact can jump to another point of a body that turns. Only where this can be more than `_SEEN`, the gap is
    measured; gaps to planes mostly have a closed form. Shallower overlaps are left to the next step. Overlaps that were
    deep at the start are opened over time, here by this deviation.

    Args:
        contacts: geoms of MuJoCo's contacts in the middle of the step, (ncon, 2), and their gaps, (ncon,).
        rows: groups, amounts and rates of the step, see `rows.Rows`.
        geometry: MuJoCo's geom_bodyid, geom_type and geom_size, and geom_xpos and geom_xmat at the end of the step.
        motion: cvel, cdof_dot and qvel at the end of the step, body_parentid, body_dofadr, body_dofnum, xipos,
            subtree_com, body_rootid, and the result of `margins.write_sizes`.
        mocap: index of the mocap body that each body is, or -1, (nbody,).
        surface_speed: speed of the fastest point of mocap bodies, m/s; gaps to bodies that move are measured.
        at: addresses of the model and of its data at the end of the step.
        timestep: h, s.
        again: whether overlaps have been corrected already; then only new overlaps count.
    """
    (geoms, gaps), (body_of_geom, shape, extent, place, turned) = contacts, geometry
    velocity, root, size = motion[0], motion[8], motion[9]
    g, end, deepest, slow = 0, 0, 0.0, 0.0
    while end < len(geoms):
        first, one, other = end, geoms[end, 0], geoms[end, 1]
        while end < len(geoms) and geoms[end, 0] == one and geoms[end, 1] == other:
            end += 1
        while g < rows[0].shape[1] and rows[0][3, g] < first:
            g += 1
        gap = _plane_gap(one, other, shape, extent, place, turned)
        if gap >= -_SEEN:
            continue
        falls, along, old = _foresee(first, end, g, gaps, rows, timestep)
        if falls == np.inf or (again and old):
            continue
        a, b = body_of_geom[one], body_of_geom[other]
        turn = 0.125 * timestep**2 * (_acceleration(a, motion) + _acceleration(b, motion))
        turn += 0.5 * timestep * (along + jump_speed(a, b, (shape[one], shape[other]), (size[a], size[b]), velocity))
        bends = turn > _SEEN and falls < turn
        measured = bends or (surface_speed > 0.0 and (mocap[root[a]] >= 0 or mocap[root[b]] >= 0))
        if gap == -np.inf and not old and measured and shape[one] != _SDF and shape[other] != _SDF:
            gap = line_gap((shape, extent, place, turned), one, other)
            if gap == -np.inf:
                gap = mj.geom_distance(at[0], at[1], one, other, APART, 0)
        if gap == -np.inf or old:
            if bends and not again:
                deepest, slow = max(deepest, turn), max(slow, turn)
        elif gap < -_SEEN:
            deepest = max(deepest, -gap)
    return deepest, slow


@kernel
def end_targets(groups, key, amounts, slow, before_key, before, timestep):
    """Return how fast positions must move to open overlaps, m/s, (g,), and whether any must.

    Overlaps that were deep at the start of the step are opened by at most a distance, m, other overlaps completely.

    Args:
        groups: see `rows.Rows`, like the next two.
        key: keys of groups.
        amounts: gaps first.
        slow: largest opening of old overlaps, m.
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
                    need[g] = min(-gap, slow) / timestep
    return need, some


class EndCorrection:
    """Finds overlaps at the end of a step, and the shift of positions that opens them."""

    def __init__(self, model: mujoco.MjModel, size: np.ndarray, options: TemporaryOptions, reader: RowReader):
        self._model, self._size, self._options, self._reader = model, size, options, reader

    @cached_property
    def _other(self) -> mujoco.MjData:
        """Other data of the model."""
        return mujoco.MjData(self._model)

    def begins_deep(self, rows: Rows, known: Known | None, start: np.ndarray) -> bool:
        """Return what `overlaps.begins_deep` returns, for the position at the start of the step, (nq,)."""
        model, keys = self._model, np.zeros(0, np.int64) if known is None else known.key
        now, geometry = self._other, (model.body_rootid, model.geom_bodyid, model.geom_type)
        scene = model.opt.timestep, model.body_mocapid, geometry
        return for_python(begins_deep)(rows, keys, *scene, start, now.qpos, (model._address, now._address))

    def correct(
        self,
        data: mujoco.MjData,
        rows: Rows,
        found: tuple[np.ndarray, np.ndarray],
        metric: Inertia,
        surface_speed: float,
    ) -> bool:
        """Open the overlaps of data; return whether new ones of more than `COUNTED` remain.

        Args:
            data: state and frames at the end of the step.
            rows: the rows of the step.
            found: geoms and gaps of the contacts that these rows belong to, (ncon, 2) and (ncon,).
            metric: the mass matrix of the step.
            surface_speed: see `bend`.
        """
        model, forces = self._model, (rows.groups, rows.amounts, rows.rates)
        geometry = model.geom_bodyid, model.geom_type, model.geom_size, data.geom_xpos, data.geom_xmat
        motion = (
            data.cvel, data.cdof_dot, data.qvel, model.body_parentid, model.body_dofadr, model.body_dofnum, data.xipos,
            data.subtree_com, model.body_rootid, self._size,
        )  # fmt: skip
        surfaces, at = (model.body_mocapid, surface_speed), (model._address, data._address)
        measured = partial(for_python(bend), found, forces, geometry, motion, *surfaces, at, model.opt.timestep)
        depth, slow = measured(False)
        for _ in range(ROUNDS if depth > 0.0 else 0):
            before, shift = depth, self._shift(data, rows, depth, slow, metric)
            if shift is not None:
                mujoco.mj_integratePos(model, data.qpos, shift, model.opt.timestep)
                update_frames(model, data)
            depth, slow = measured(True)
            if shift is None or depth == 0.0 or depth > LITTLE * before:
                break
        return depth > COUNTED

    def _shift(self, data: mujoco.MjData, rows: Rows, depth: float, slow: float, metric: Inertia) -> np.ndarray | None:
        """Return the velocity, (nv,), that opens the overlaps of data within one timestep; None if there are none."""
        model, h = self._model, self._model.opt.timestep
        self._options.tighten_margins(max(BEYOND * depth, CLOSE))
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
        need, some = for_python(end_targets)(seen.groups, seen.key, seen.amounts, slow, rows.key, started, h)
        return for_python(open_overlaps)(seen, need, h, metric) if some else None

    def _look(self, data: mujoco.MjData) -> mujoco.MjData:
        """Return data with the current contacts."""
        model, now = self._model, self._other
        now.qpos[:], now.eq_active[:] = data.qpos, data.eq_active
        now.mocap_pos[:], now.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        mujoco.mj_kinematics(model, now)
        if self._options.stands:
            find_standing(model, now)
        else:
            mujoco.mj_collision(model, now)
        if now.ncon:
            find_nearest(model, now, beside=self._options.beside)
        return now
