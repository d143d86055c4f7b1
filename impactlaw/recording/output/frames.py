"""Record frames: states, body poses, energies and closed contacts, one row per step."""

from typing import Any

import mujoco
import numpy as np

from impactlaw.recording.geometry import Group
from impactlaw.recording.layout import CONTACTS, ENERGY, FRAME_TIME, FRAMES, QPOS, QVEL, STATE, Column, time_columns
from impactlaw.scene.contacts import Contacts, update_positions
from impactlaw.scene.tolerances import GAP_TOLERANCE


class Frames:
    """A buffer of frames since the last `send`.

    Poses and energies are computed on a private copy of the state. Thus they match the positions and velocities (after
    ``mj_step``, MjData holds poses and inertia of the state before), and the simulation's data remain unchanged.
    """

    def __init__(self, model: mujoco.MjModel, groups: list[Group]):
        self._model = model
        self._data = mujoco.MjData(model)
        self._moving = [group for group in groups if not group.fixed]
        self._bodies = np.concatenate([np.zeros(0, int), *(group.bodies for group in self._moving)]).astype(int)
        self._rows: list[tuple[Any, ...]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, data: mujoco.MjData, clock: float, contacts: Contacts | None) -> None:
        """Add a frame; ``clock`` is its time on the timeline, s."""
        own = self._data
        own.qpos[:], own.qvel[:] = data.qpos, data.qvel
        own.mocap_pos[:], own.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        self._update()
        potential, kinetic = own.energy
        state = data.time, clock, data.qpos.copy(), data.qvel.copy(), (kinetic, potential, kinetic + potential)
        closed = data.contact.pos[data.contact.dist <= GAP_TOLERANCE] if contacts is None else contacts.position
        self._rows.append((*state, own.xpos[self._bodies], own.xquat[self._bodies], closed))

    def initial_pose(self, group: Group) -> Any:
        """Return the poses of the group's bodies in the model's reference configuration, for rerun."""
        import rerun as rr

        data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, data)
        return rr.InstancePoses3D(**_poses(data.xpos[group.bodies], data.xquat[group.bodies]))

    def send(self, stream: Any, first_step: int) -> None:
        """Send the buffered frames to a rerun stream, times last: a frame whose time is in the file is complete."""
        import rerun as rr

        n = len(self)
        if n == 0:
            return
        time, clock, qpos, qvel, energy, position, quaternion, contacts = zip(*self._rows, strict=True)
        index = time_columns(clock, np.arange(first_step, first_step + n))
        placed, start = (np.array(position, np.float32), np.array(quaternion, np.float32)), 0
        for group in self._moving:
            size = len(group.bodies)
            poses = rr.InstancePoses3D.columns(**_poses(*(part[:, start : start + size] for part in placed)))
            stream.send_columns(group.path, index, poses.partition(np.full(n, size)), strict=True)
            start += size
        points = rr.Points3D.columns(positions=np.concatenate(contacts)).partition([len(part) for part in contacts])
        stream.send_columns(CONTACTS, index, points, strict=True)
        energies = rr.Scalars.columns(scalars=np.ravel(energy)).partition(np.full(n, 3))
        stream.send_columns(ENERGY, index, energies, strict=True)
        state = [Column(QPOS, "floats", qpos), Column(QVEL, "floats", qvel)]
        stream.send_columns(STATE, index, state, strict=True)
        stream.send_columns(FRAMES, index, [Column(FRAME_TIME, "float", time)], strict=True)
        self._rows = []

    def _update(self) -> None:
        model, own = self._model, self._data
        update_positions(model, own)
        if model.nflex:
            mujoco.mj_flex(model, own)
        mujoco.mj_energyPos(model, own)
        mujoco.mj_energyVel(model, own)


def _poses(position: np.ndarray, quaternion: np.ndarray) -> dict[str, Any]:
    return {
        "translations": position.reshape(-1, 3),
        "quaternions": quaternion.reshape(-1, 4)[:, [1, 2, 3, 0]],  # w is last in rerun
    }
