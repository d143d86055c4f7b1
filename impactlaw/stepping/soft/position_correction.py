"""Move colliding bodies where MuJoCo's force would push a contact faster than the law opens it.

A collision is detected up to a timestep after its contact has closed. Until the contact is open again, MuJoCo's force
acts beside the law: its friction lifts a body that slides on, and its spring throws the body if it is too stiff for the
timestep, or if the law opens the contact slowly. Colliding bodies are therefore put where they would be if the law had
acted when their contacts closed: over the time tau since then, the change of velocity has moved them by
``tau (v+ - v-)``, and such contacts are open. Bodies that MuJoCo's contacts would not push stay where they are. So do
bodies whose contact was closed long before and left to MuJoCo: bodies at rest, such as a figure that lies on a floor,
would be moved again and again.

Free bodies have their angular velocity in axes of their own, which this move turns. A body with the same inertia about
all axes, such as a ball, keeps its angular velocity in the axes of the world, and its energy with it.
"""

from __future__ import annotations

import mujoco
import numpy as np

from impactlaw.scene.contacts import row_velocities
from impactlaw.stepping.soft.rebounds import Normals
from impactlaw.stepping.soft.tolerances import JUST_CLOSED, OPENING

_DISCRETE = int(mujoco.mjtIntegrator.mjINT_DISCRETE)
_CONES = [int(getattr(mujoco.mjtConstraint, f"mjCNSTR_CONTACT_{name}")) for name in ("PYRAMIDAL", "ELLIPTIC")]
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
ROUND = 1e-6
"""Relative difference of the moments of inertia up to which a body has the same inertia about all axes."""
_ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


def put_back(
    model: mujoco.MjModel, data: mujoco.MjData, before: np.ndarray, contacts: Normals, rest_speed: float
) -> None:
    """Put bodies where they would be if the law had acted when their contacts closed, and update positions.

    With the integrator "discrete" no body is moved, since it computes the springs of contacts only later.

    Args:
        model: the scene.
        data: the state with the velocity after the collisions; everything else is still as before them.
        before: the velocity before the collisions, (nv,).
        contacts: the contacts and limits.
        rest_speed: closing speed above which contacts collide, m/s or rad/s.
    """
    if model.opt.integrator == _DISCRETE:
        return
    (rows, pair, drift, chosen), after = contacts, row_velocities(model, data, data.qvel)
    closing, opening = contacts.of(data.efc_vel) + drift, contacts.of(after) + drift
    depth = data.efc_margin[rows] - data.efc_pos[rows]
    fresh = (depth > 0.0) & (depth < -JUST_CLOSED * model.opt.timestep * closing)
    found = chosen & (closing < -rest_speed) & (opening > OPENING * rest_speed) & fresh
    stiffness, damping, impedance = data.efc_KBIP.reshape(-1, 4)[: data.nefc, :3].T
    wanted = stiffness * impedance * (data.efc_margin - data.efc_pos) - damping * after
    for i in np.flatnonzero(found):
        found[i] = _push(data, wanted, rows[i], is_pair=pair[i] > rows[i]) > 0.0
    if found.any():
        since = np.minimum(depth[found] / -closing[found], model.opt.timestep)
        _move(model, data, data.qvel - before, rows[found], since)


def _push(data: mujoco.MjData, wanted: np.ndarray, row: int, *, is_pair: bool) -> float:
    """Return the normal acceleration that a contact by itself asks for, m/s^2; at 0 or less it does not push.

    Args:
        data: the state.
        wanted: reference accelerations of MuJoCo's rows, (nefc,).
        row: first row of the contact.
        is_pair: whether it begins a pyramid.
    """
    contact = data.efc_id[row]
    if data.efc_type[row] not in _CONES:
        return float(wanted[row])
    sliding = int(data.contact.dim[contact]) - 1
    if is_pair:
        return float(wanted[row : row + 2 * sliding].max())
    friction = data.contact.friction[contact, :sliding] * wanted[row + 1 : row + 1 + sliding]
    return float(wanted[row] + np.linalg.norm(friction))


def _move(model: mujoco.MjModel, data: mujoco.MjData, change: np.ndarray, rows: np.ndarray, since: np.ndarray) -> None:
    """Move each island by its change of velocity, (nv,), times the longest time since one of its rows has closed, s."""
    # numba is not loaded before it is used
    from impactlaw.stepping.compiled.dense import sparse_jacobian
    from impactlaw.stepping.compiled.islands import find_islands

    jacobian, trees = sparse_jacobian(model, data), model.dof_treeid
    island, of_row = find_islands(data.efc_type, data.efc_id, *jacobian, trees, model.ntree)
    longest = np.zeros(model.ntree)
    np.maximum.at(longest, of_row[rows], since)
    move = longest[island[trees]] * change
    mujoco.mj_integratePos(model, data.qpos, move, 1.0)
    _keep_spin(model, data, move)
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_sensorPos(model, data)
    if model.opt.enableflags & _ENERGY:
        mujoco.mj_energyPos(model, data)


def _keep_spin(model: mujoco.MjModel, data: mujoco.MjData, move: np.ndarray) -> None:
    """Keep the angular velocity, in the axes of the world, of round free bodies that a move, (nv,), has turned."""
    back = np.empty(4)
    for dof in model.jnt_dofadr[model.jnt_type == _FREE]:
        turn = slice(dof + 3, dof + 6)
        angle, inertia = float(np.linalg.norm(move[turn])), model.dof_M0[turn]
        if angle > 0.0 and model.dof_simplenum[dof] and np.ptp(inertia) <= ROUND * inertia.max():
            mujoco.mju_axisAngle2Quat(back, move[turn] / angle, -angle)
            mujoco.mju_rotVecQuat(data.qvel[turn], data.qvel[turn].copy(), back)
