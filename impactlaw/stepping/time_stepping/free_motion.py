"""The part of a step before its contact problem: the midpoint, and the velocity due to forces alone."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.inertial_forces import InertialForces
from impactlaw.stepping.time_stepping.margins import narrow, outruns, write_margins, write_sizes
from impactlaw.stepping.time_stepping.problem.detection.contact_points import mend
from impactlaw.stepping.time_stepping.problem.detection.far_contacts import leave_far_out, some_close, take_back
from impactlaw.stepping.time_stepping.problem.detection.nearest_points import find_nearest
from impactlaw.stepping.time_stepping.problem.forces import without_far_limits
from impactlaw.stepping.time_stepping.standing_cylinders import find_standing
from impactlaw.stepping.time_stepping.temporary_options import EXACT, TemporaryOptions
from impactlaw.stepping.time_stepping.tolerances import SHARES

_FULL = [int(mujoco.mjtWarning.mjWARN_CONTACTFULL), int(mujoco.mjtWarning.mjWARN_CNSTRFULL)]

_NO_ACTUATION = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)


def update_frames(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Update frames and velocities of bodies to the state."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)


def frames_of(data: mujoco.MjData) -> tuple[bytes, ...]:
    """Return one field of each stage of `update_frames`, to notice a state that was loaded without calling it."""
    return data.xipos.tobytes(), data.subtree_com.tobytes(), data.cvel.tobytes()


def update_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Update lengths of tendons and the mass matrix to the frames."""
    if model.ntendon:
        mujoco.mj_tendon(model, data)
    mujoco.mj_makeM(model, data)


def reach(
    model: mujoco.MjModel, data: mujoco.MjData, gained: np.ndarray, sizes: np.ndarray, surface: float
) -> np.ndarray:
    """Set margins such that MuJoCo finds the contacts that bodies can reach in this step.

    Return the velocities of bodies at its start; those to which forces lead are in data, (nbody, 6).
    """
    geoms = model.geom_type, model.geom_bodyid, model.geom_pos, model.geom_rbound
    for_python(write_sizes)(sizes, *geoms, model.body_ipos)
    velocity, now = data.qvel.copy(), data.cvel.copy()
    data.qvel += gained
    mujoco.mj_comVel(model, data)
    data.qvel[:] = velocity
    _set_margins(model, data, now, data.cvel, sizes, surface)
    return now


def _set_margins(
    model: mujoco.MjModel, data: mujoco.MjData, now: np.ndarray, led_to: np.ndarray, sizes: np.ndarray, surface: float
) -> None:
    gravity = model.opt.gravity
    for_python(write_margins)(
        model.body_margin, model.geom_margin, model.geom_gap, model.pair_margin, model.pair_gap,
        model.jnt_margin, model.tendon_margin, *_places(model, data, sizes), now, led_to, surface,
        model.opt.timestep, float(np.sqrt(gravity.dot(gravity))), np.empty((5, model.nbody)),
    )  # fmt: skip


def _places(model: mujoco.MjModel, data: mujoco.MjData, sizes: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    """Return what `margins.write_margins` needs of bodies and shapes."""
    bodies = model.body_rootid, model.body_treeid, model.body_mocapid, sizes, data.xipos, data.subtree_com
    return bodies, (model.geom_bodyid, model.geom_type, data.geom_xpos, data.geom_xmat, model.geom_aabb)


def outrun(model: mujoco.MjModel, data: mujoco.MjData, sizes: np.ndarray) -> bool:
    """Return whether a collision throws a body farther in a timestep than contacts were looked for."""
    mujoco.mj_comVel(model, data)
    places, room, moves = _places(model, data, sizes), np.empty((2, model.nbody)), (data.cvel, model.opt.timestep)
    left_out = data.ncon > 0 and for_python(some_close)(*_far_contacts(model, data, sizes), *moves)
    return bool(left_out or for_python(outruns)(model.geom_margin, *places, *moves, room))


def _far_contacts(model: mujoco.MjModel, data: mujoco.MjData, sizes: np.ndarray) -> tuple[Any, ...]:
    """Return the first arguments of `far_contacts.leave_far_out`."""
    found, bodies = data.contact, (model.geom_bodyid, model.body_rootid, sizes, data.subtree_com)
    return (found.dist, found.pos, found.geom, found.exclude, found.efc_address), bodies, model.geom_type


def detect_farther(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    options: TemporaryOptions,
    start: np.ndarray,
    free: np.ndarray,
    middle: np.ndarray,
    sizes: np.ndarray,
    surfaces: Surfaces | None,
) -> bool:
    """Find the contacts that bodies can reach after a collision, with data as it was without contact.

    All contacts that were found before are found again, even if they are now out of reach: they may have caused the
    collision. Return whether MuJoCo had no room for all contacts.
    """
    led_to, before = data.cvel.copy(), options.margins()
    data.qpos[:], data.qvel[:] = middle, start
    mujoco.mj_comVel(model, data)
    _set_margins(model, data, data.cvel, led_to, sizes, 0.0 if surfaces is None else surfaces.speed)
    options.widen_margins(before)
    overflown = _find_contacts(model, data, options, surfaces)
    mujoco.mj_fwdVelocity(model, data)
    data.qvel[:] = free
    return overflown


def to_midpoint(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    surfaces: Surfaces | None,
    options: TemporaryOptions,
    now: np.ndarray,
    sizes: np.ndarray,
) -> tuple[np.ndarray, bool]:
    """Move bodies to the middle of the step, and compute all forces except those of contact there.

    ``now`` is the result of `reach`. Return the configuration, (nq,), and whether MuJoCo had no room for all contacts.
    """
    h = model.opt.timestep
    if surfaces is not None:
        time = data.time
        data.time = time + 0.5 * h
        surfaces.place(data)
        data.time = time
    mujoco.mj_integratePos(model, data.qpos, data.qvel, 0.5 * h)
    middle = data.qpos.copy()
    overflown = _find_contacts(model, data, options, surfaces, (now, sizes))
    if model.nsensordata:
        data.flg_subtreevel = data.flg_rnepost = False  # otherwise MuJoCo would reuse results of the last step
        data.flg_energypos = data.flg_energyvel = False
        without_far_limits(mujoco.mj_sensorPos, model, data)
    mujoco.mj_fwdVelocity(model, data)
    if model.nsensordata:
        without_far_limits(mujoco.mj_sensorVel, model, data)
    control = mujoco.get_mjcb_control()
    if control is not None and not model.opt.disableflags & _NO_ACTUATION:
        control(model, data)
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)
    return middle, overflown


def _find_contacts(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    options: TemporaryOptions,
    surfaces: Surfaces | None,
    motion: tuple[np.ndarray, np.ndarray] | None = None,
) -> bool:
    """Compute everything that depends on positions, with smaller margins if MuJoCo has no room for all contacts.

    Contacts that are too far away get no rows, if the ``motion`` is given: velocities and sizes of bodies.
    """
    mended = full = cut = False
    for share in (*SHARES, 1.0):
        seen = data.warning.number[_FULL].sum()
        mujoco.mj_fwdPosition(model, data)
        mended = options.stands and find_standing(model, data, found=True, surfaces=surfaces)
        full = data.warning.number[_FULL].sum() != seen
        if full:
            options.scale_margins(share)
        pairs = data.contact.geom, model.geom_type, model.geom_margin, model.pair_margin
        cut = data.ncon > 0 and bool(for_python(narrow)(*pairs, share))
        if not full and not cut:
            break
    mended |= _mend_contacts(model, data, options)
    own = options.sticks or model.nflex > 0  # then MuJoCo reads rows, or has contacts of its own
    if data.ncon and motion is not None and not own:
        speed, gravity = 0.0 if surfaces is None else surfaces.speed, model.opt.gravity
        moves = motion[0], data.cvel, speed, model.opt.timestep, float(np.sqrt(gravity.dot(gravity)))
        mended |= bool(for_python(leave_far_out)(*_far_contacts(model, data, motion[1]), *moves))
    if mended:
        _make_rows(model, data)
    return full or cut


def _make_rows(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_makeConstraint(model, data)
    if model.opt.enableflags & EXACT:
        mujoco.mj_projectConstraint(model, data)


def take_far_back(
    model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray, middle: np.ndarray, sizes: np.ndarray
) -> None:
    """Make rows of contacts that were left out if forces can close one, with data as it is without contact."""
    if not data.ncon or not data.contact.exclude.any():
        return
    free = data.qvel.copy()
    mujoco.mj_comVel(model, data)
    taken = for_python(take_back)(*_far_contacts(model, data, sizes), data.cvel, model.opt.timestep)
    data.qvel[:] = start
    mujoco.mj_comVel(model, data)
    if taken:
        data.qpos[:] = middle
        _make_rows(model, data)
        mujoco.mj_referenceConstraint(model, data)
    data.qvel[:] = free


def _mend_contacts(model: mujoco.MjModel, data: mujoco.MjData, options: TemporaryOptions) -> bool:
    """Correct contacts; return whether any has changed. See `problem.detection.contact_points`."""
    nearer = data.ncon > 0 and find_nearest(model, data, beside=options.beside)
    found, bodies = data.contact, (model.geom_bodyid, model.body_weldid, model.body_treeid)
    shapes, at = (model.geom_type, model.geom_size, data.geom_xpos, data.geom_xmat), (model._address, data._address)
    contacts = found.dist, found.pos, found.frame, found.geom
    return bool(data.ncon > 0 and for_python(mend)(contacts, found.dim, bodies, shapes, at)) or nearer


def free_step(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    options: TemporaryOptions,
    inertial: InertialForces,
    start: np.ndarray,
    held: np.ndarray,
) -> Inertia:
    """Advance velocity, activations and time by MuJoCo's integrator without contact; return the inertia of the step."""
    data.qacc[:] = data.qacc_smooth
    data.qfrc_constraint[:] = 0.0
    options.integrator(model, data)
    factor = (data.qH, data.qHDiagInv) if options.damped else (data.qLD, data.qLDiagInv)
    metric = Inertia(*factor, model.M_rownnz, model.M_rowadr, model.M_colind)
    if inertial.act:
        data.qvel[:] = inertial.settle(data, start, held, metric, model.opt.timestep)
    return metric


def limit_energy(
    model: mujoco.MjModel, data: mujoco.MjData, inertial: InertialForces, start: np.ndarray, velocity: np.ndarray
) -> None:
    """Scale down velocities of trees that turn fast, so that they gain no more energy than forces and contact gave."""
    end, forces = data.qpos.copy(), data.qfrc_smooth + data.qfrc_bias - inertial.gravity + data.qfrc_constraint
    work = _of_trees(model, forces, model.opt.timestep * (velocity + data.qvel))
    data.qpos[:] = start
    update_frames(model, data)
    allowed = np.maximum(0.0, _of_trees(model, _momentum(model, data, velocity), velocity) + work)
    data.qpos[:] = end
    update_frames(model, data)
    found = _of_trees(model, _momentum(model, data, data.qvel), data.qvel)
    share = np.sqrt(np.divide(allowed, found, out=np.ones_like(found), where=inertial.turning & (found > allowed)))
    data.qvel *= share[model.dof_treeid]
    mujoco.mj_comVel(model, data)


def _momentum(model: mujoco.MjModel, data: mujoco.MjData, velocity: np.ndarray) -> np.ndarray:
    """Return ``M v`` at the current state, (nv,)."""
    momentum = np.empty(model.nv)
    update_inertia(model, data)
    mujoco.mj_mulM(model, data, momentum, velocity.copy())
    return momentum


def _of_trees(model: mujoco.MjModel, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the inner product of two vectors, restricted to each tree of bodies, (ntree,)."""
    return np.bincount(model.dof_treeid, one * other, model.ntree)
