"""Limits of joints and tendons as unilateral contacts: the gap is the distance from the limit, in m or rad."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.scene.contacts import Contacts, constraint_rows

_JOINT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_TENDON = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)
_BALL = int(mujoco.mjtJoint.mjJNT_BALL)
_WRAP_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
NO_GEOM = -1
"""The geom ids of a contact that is a limit."""


def slack_ropes(model: mujoco.MjModel) -> np.ndarray:
    """Return the tendons through sites whose lower limit is 0 or less, int (k,).

    That limit never acts: where the ends of a rope pass each other, its length grows again from 0.
    """
    if not model.ntendon:
        return np.zeros(0, dtype=int)
    sites = model.wrap_type[model.tendon_adr] != _WRAP_JOINT
    return np.flatnonzero(sites & (model.tendon_range[:, 0] <= 0.0))


class LimitRows(NamedTuple):
    """Limits that are near or reached."""

    code: np.ndarray  # number of each limit, which never changes, ascending, int (l,)
    gap: np.ndarray  # distance from the limit, m or rad, (l,)
    jacobian: np.ndarray  # gap gradients, (l, nv)


class LimitState(NamedTuple):
    """A copy of the arrays of MuJoCo's data that describe limits, under the same names."""

    efc_id: np.ndarray
    efc_type: np.ndarray
    efc_pos: np.ndarray
    qpos: np.ndarray
    ten_length: np.ndarray
    xanchor: np.ndarray
    xaxis: np.ndarray

    @classmethod
    def of(cls, data: mujoco.MjData) -> LimitState:
        """Return a copy of the current arrays."""
        return cls(*(getattr(data, name).copy() for name in cls._fields))


class Limits:
    """The limits of the joints and tendons of one scene.

    Attributes:
        labels: name of the joint or tendon by code; each has two codes, for the lower and the upper limit.
        of_rows: whether MuJoCo's constraint rows are needed to find limits, since ball joints or tendons have some.
    """

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        joints = [model.joint(i).name or f"joint{i}" for i in range(model.njnt)]
        tendons = [model.tendon(i).name or f"tendon{i}" for i in range(model.ntendon)]
        self.labels = tuple(name for name in joints + tendons for _ in range(2))
        self._limited = np.concatenate([model.jnt_limited, model.tendon_limited]).astype(bool)
        self._exist = bool(self._limited.any())
        self.of_rows = bool(model.tendon_limited.any() or (model.jnt_limited & (model.jnt_type == _BALL)).any())
        joint = np.repeat(np.flatnonzero(model.jnt_limited), 2)
        upper = np.arange(len(joint)) % 2
        self._code_of, self._side = 2 * joint + upper, 1.0 - 2.0 * upper
        self._position = model.jnt_qposadr[joint]
        self._gradients = np.zeros((len(joint), model.nv))
        self._gradients[np.arange(len(joint)), model.jnt_dofadr[joint]] = self._side
        self._bound = model.jnt_range[joint, upper]

    def __bool__(self) -> bool:
        return self._exist

    @property
    def names(self) -> tuple[str, ...]:
        """Labels of all limits of the scene."""
        return tuple(label for label, on in zip(self.labels[::2], self._limited, strict=True) if on)

    def near(self, data: mujoco.MjData, within: float) -> LimitRows | None:
        """Return the limits of hinges and slides with a gap below ``within``, m or rad; None if there are none.

        The gaps are ``q - lower`` and ``upper - q``.
        """
        gap = (data.qpos.take(self._position) - self._bound) * self._side
        near = (gap < within).nonzero()[0]
        if not len(near):
            return None
        return LimitRows(self._code_of.take(near), gap.take(near), self._gradients.take(near, axis=0))

    def read(self, data: mujoco.MjData) -> LimitRows:
        """Return the limits among MuJoCo's current constraint rows (``mj_makeConstraint``)."""
        rows = np.flatnonzero((data.efc_type == _JOINT) | (data.efc_type == _TENDON))
        code = np.array([self.code(data, row) for row in rows.tolist()], dtype=int)
        return LimitRows(code, data.efc_pos[rows], constraint_rows(self._model, data, rows))

    def code(self, data: mujoco.MjData | LimitState, row: int) -> int:
        """Return the code of the limit to which a constraint row of MuJoCo belongs."""
        model, i, gap = self._model, int(data.efc_id[row]), data.efc_pos[row]
        if data.efc_type[row] == _TENDON:
            value, span, number = data.ten_length[i], model.tendon_range[i], model.njnt + i
        elif model.jnt_type[i] == _BALL:
            return 2 * i + 1
        else:
            value, span, number = data.qpos[model.jnt_qposadr[i]], model.jnt_range[i], i
        return 2 * number + int(abs(gap - (value - span[0])) > abs(gap - (span[1] - value)))

    def contacts(self, data: mujoco.MjData, rows: LimitRows) -> Contacts:
        """Return the limits as contacts: at the joint's anchor, along its axis; at the origin for tendons."""
        labels = tuple(self.labels[code] for code in rows.code)
        return Contacts(labels, np.full((len(labels), 2), NO_GEOM), rows.gap, *self.places(data, rows.code))

    def places(self, data: mujoco.MjData | LimitState, code: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and normals of limits, (l, 3) each; see `Contacts`."""
        number, side = code >> 1, (1.0 - 2.0 * (code & 1))[:, None]
        if not self._model.ntendon:
            return data.xanchor.take(number, axis=0), data.xaxis.take(number, axis=0) * side
        joint = number < self._model.njnt
        position, normal = np.zeros((len(code), 3)), np.zeros((len(code), 3))
        position[joint], normal[joint] = data.xanchor[number[joint]], data.xaxis[number[joint]] * side[joint]
        return position, normal
