"""The part of a step before its contact problem: the midpoint, and the velocity due to forces alone."""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.compiled import for_python
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.stepping.compiled.whitening import Inertia
from impactlaw.stepping.time_stepping.compiled import far_contacts, midpoint
from impactlaw.stepping.time_stepping.compiled.impulses.forces import settle
from impactlaw.stepping.time_stepping.compiled.midpoint import mend_contacts, set_margins
from impactlaw.stepping.time_stepping.compiled.standing_cylinders import find_standing
from impactlaw.stepping.time_stepping.compiled.state.world import World
from impactlaw.stepping.time_stepping.inertial_forces import InertialForces
from impactlaw.stepping.time_stepping.margins import narrow, write_sizes
from impactlaw.stepping.time_stepping.problem.forces import without_far_limits
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


def reach(w: World, model: mujoco.MjModel, data: mujoco.MjData, gained: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Set margins such that MuJoCo finds the contacts that bodies can reach in this step.

    Return the velocities of bodies at its start; those to which forces lead are in data, (nbody, 6).
    """
    geoms = model.geom_type, model.geom_bodyid, model.geom_pos, model.geom_rbound
    for_python(write_sizes)(sizes, *geoms, model.body_ipos)
    velocity, now = data.qvel.copy(), data.cvel.copy()
    data.qvel += gained
    mujoco.mj_comVel(model, data)
    data.qvel[:] = velocity
    for_python(set_margins)(w, now, data.cvel, np.empty(5 * model.nbody))
    return now


def outrun(w: World, model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return whether a collision throws a body farther in a timestep than contacts were looked for."""
    mujoco.mj_comVel(model, data)
    return bool(for_python(midpoint.outrun)(w, np.empty(2 * model.nbody)))


def detect_farther(
    w: World,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    options: TemporaryOptions,
    start: np.ndarray,
    free: np.ndarray,
    middle: np.ndarray,
) -> bool:
    """Find the contacts that bodies can reach after a collision, with data as it was without contact.

    All contacts that were found before are found again, even if they are now out of reach: they may have caused the
    collision. Return whether MuJoCo had no room for all contacts.
    """
    led_to, before = data.cvel.copy(), options.margins()
    data.qpos[:], data.qvel[:] = middle, start
    mujoco.mj_comVel(model, data)
    for_python(set_margins)(w, data.cvel, led_to, np.empty(5 * model.nbody))
    options.widen_margins(before)
    overflown = _find_contacts(w, model, data, options, np.empty((0, 6)))
    mujoco.mj_fwdVelocity(model, data)
    data.qvel[:] = free
    return overflown


def to_midpoint(
    w: World,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    surfaces: Surfaces | None,
    options: TemporaryOptions,
    now: np.ndarray,
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
    overflown = _find_contacts(w, model, data, options, now)
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
    w: World, model: mujoco.MjModel, data: mujoco.MjData, options: TemporaryOptions, now: np.ndarray
) -> bool:
    """Compute everything that depends on positions, with smaller margins if MuJoCo has no room for all contacts.

    Contacts that are too far away at velocities of bodies get no rows, see `midpoint.mend_contacts`.
    """
    mended = full = cut = False
    for share in (*SHARES, 1.0):
        seen = data.warning.number[_FULL].sum()
        mujoco.mj_fwdPosition(model, data)
        mended = options.stands and for_python(find_standing)(w, True)
        full = data.warning.number[_FULL].sum() != seen
        if full:
            options.scale_margins(share)
        pairs = data.contact.geom, model.geom_type, model.geom_margin, model.pair_margin
        cut = data.ncon > 0 and bool(for_python(narrow)(*pairs, share))
        if not full and not cut:
            break
    own = options.sticks or model.nflex > 0  # then MuJoCo reads rows, or has contacts of its own
    if for_python(mend_contacts)(w, now[:0] if own else now) or mended:
        _make_rows(model, data)
    return full or cut


def _make_rows(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_makeConstraint(model, data)
    if model.opt.enableflags & EXACT:
        mujoco.mj_projectConstraint(model, data)


def take_far_back(w: World, model: mujoco.MjModel, data: mujoco.MjData, start: np.ndarray, middle: np.ndarray) -> None:
    """Make rows of contacts that were left out if forces can close one, with data as it is without contact."""
    if data.ncon and for_python(far_contacts.take_far_back)(w, start):
        free = data.qvel.copy()
        data.qpos[:], data.qvel[:] = middle, start
        _make_rows(model, data)
        mujoco.mj_referenceConstraint(model, data)
        data.qvel[:] = free


def free_step(
    w: World,
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
    if inertial.act:
        inertial.turning[:], room = False, np.empty(3 * model.nv)
        for_python(settle)(w, start, held, inertial.used, inertial.turning, inertial.gravity, room)
    factor = (data.qH, data.qHDiagInv) if options.damped else (data.qLD, data.qLDiagInv)
    return Inertia(*factor, model.M_rownnz, model.M_rowadr, model.M_colind)
