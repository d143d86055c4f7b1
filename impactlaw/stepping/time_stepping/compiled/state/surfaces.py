"""Moving surfaces in compiled code, with the formulas of `scene.moving_surfaces.Surfaces`.

The memory of a world holds the state of surfaces: some numbers, and a row for each mocap body. The results of a step
become the start of the next one if the step has not failed.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import mujoco
import numpy as np

from impactlaw.scene.moving_surfaces import LastMotion
from impactlaw.scene.tolerances import BLOW, PUT
from impactlaw.solvers.cones.algebra.loops import kernel, numbers, plain, put
from impactlaw.solvers.cones.algebra.vectors import length
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.access import data_floats, offset, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, address_of, float_at, floats
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING, setting

_MEETS = 2.0
"""The value of the setting if mocap bodies can meet other bodies; otherwise it is 1."""


class Head(NamedTuple):
    """Indices of the numbers before the rows."""

    time: int = 0  # end of the last step, s; NaN if there was none
    began: int = 1  # start of this step, s
    speed: int = 2  # largest speed of a point of a moving surface in this step, m/s
    moves: int = 3  # 1 if bodies that can meet others move in this step
    still: int = 4  # 1 if no body moves in this step, nor did at the end of the last step


class Row(NamedTuple):
    """First indices of the parts of a body's row: poses have 7 numbers, velocities 6."""

    target: int = 0  # pose at the end of the last step
    mean: int = 7  # mean velocity of the last step
    last: int = 13  # velocity at the end of the last step
    start: int = 19  # pose at the start of this step
    to: int = 26  # pose at the end of this step
    through: int = 33  # mean velocity of this step
    first: int = 39  # velocity at the start of this step
    end: int = 45  # velocity at the end of this step
    now: int = 51  # velocity in the middle of this step
    width: int = 57  # length of a row


HEAD, ROW = Head(), Row()


def surface_room(model: mujoco.MjModel) -> int:
    """Return the number of values that the memory of a world holds for its mocap bodies."""
    return len(HEAD) + ROW.width * model.nmocap if model.nmocap else 0


def forget_surfaces(memory: np.ndarray, worlds: Any, model: mujoco.MjModel) -> None:
    """Clear the last motion of surfaces for some worlds, in their memories, (nsim, n)."""
    if model.nmocap:
        memory[worlds, memory.shape[1] - surface_room(model) + HEAD.time] = np.nan


def _kept(numbers: np.ndarray, model: mujoco.MjModel) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the parts of a world's memory for mocap bodies: head, targets, mean and last velocities."""
    kept = numbers[len(numbers) - surface_room(model) :]
    rows = kept[len(HEAD) :].reshape(model.nmocap, ROW.width)
    return kept, [rows[:, a:b] for a, b in pairwise((ROW.target, ROW.mean, ROW.last, ROW.start))]


def put_motion(numbers: np.ndarray, model: mujoco.MjModel, motion: LastMotion | None) -> None:
    """Set the motion of mocap bodies in the last step of a world, if there are any."""
    if motion is None or not model.nmocap:
        return
    head, parts = _kept(numbers, model)
    head[HEAD.time] = motion.time
    for part, value in zip(parts, motion[1:], strict=True):
        part[:] = value


@plain
def _time(w):
    return float_at(w.data + offset(w, DATA.time))


@kernel
def _head(w):
    return floats(w.surfaces, len(HEAD))


@kernel
def _rows(w):
    return floats(w.surfaces + 8 * len(HEAD), (size(w, MODEL.nmocap), ROW.width))


@plain
def _speed(row, at, arm):
    """Return the largest speed of a point of a body at a velocity in its row, m/s."""
    return length(row[at:]) + arm * length(row[at + 3 :])


@kernel
def _begin(w, row, goes_on, arm):
    """Find the motion of a body in a step; return the largest speed of its points, m/s, and whether it moves at all."""
    h, turn, change = w.timestep, numbers(3), numbers(6)
    far = 0.0
    for k in range(3):
        far += (row[ROW.to + k] - row[ROW.target + k]) ** 2
    goes_on = goes_on and np.sqrt(far) <= max(2.0 * arm, PUT * setting(w, SETTING.meter) * h)
    put(row[ROW.start : ROW.to], row[ROW.target : ROW.mean] if goes_on else row[ROW.to : ROW.through])
    row[ROW.through : ROW.first] = 0.0
    turned = False
    for k in range(3):
        row[ROW.through + k] = (row[ROW.to + k] - row[ROW.start + k]) / h
    for k in range(3, 7):
        turned = turned or row[ROW.to + k] != row[ROW.start + k]
    if turned:
        start = address_of(row) + 8 * (ROW.start + 3)
        mj.sub_quat(address_of(turn), address_of(row) + 8 * (ROW.to + 3), start)
        for k in range(3):
            turn[k] /= h
        mj.rotate(address_of(row) + 8 * (ROW.through + 3), address_of(turn), start)
    moves = False
    for k in range(6):
        mean = row[ROW.through + k]
        known = row[ROW.mean + k] if goes_on else mean
        before = row[ROW.last + k] if goes_on else mean
        change[k] = mean - known
        row[ROW.first + k], row[ROW.end + k] = before, 1.5 * mean - 0.5 * known
        moves = moves or before != 0.0 or mean != 0.0 or row[ROW.end + k] != 0.0
    if _speed(change, 0, arm) > BLOW * setting(w, SETTING.meter):
        for k in range(6):
            row[ROW.first + k] = row[ROW.end + k] = row[ROW.through + k]
    for k in range(6):
        change[k] = 1.5 * row[ROW.through + k] - 0.25 * (row[ROW.first + k] + row[ROW.end + k])
    return max(_speed(row, ROW.first, arm), _speed(row, ROW.end, arm), _speed(change, 0, arm)), moves


@kernel
def begin_surfaces(w):
    """Start a step in which bodies move to the poses in data, from the poses at the end of the last step."""
    head, rows, m = _head(w), _rows(w), size(w, MODEL.nmocap)
    position, quaternion = data_floats(w, DATA.mocap_pos, 3 * m), data_floats(w, DATA.mocap_quat, 4 * m)
    arm = floats(w.sizes + 8 * size(w, MODEL.nbody), m)
    head[HEAD.began] = _time(w)
    goes_on, fastest, moving = head[HEAD.time] == head[HEAD.began], 0.0, False
    for i in range(m):
        put(rows[i, ROW.to : ROW.to + 3], position[3 * i : 3 * i + 3])
        put(rows[i, ROW.to + 3 : ROW.through], quaternion[4 * i : 4 * i + 4])
        mj.normalize4(address_of(rows[i]) + 8 * (ROW.to + 3))  # as MuJoCo does when it places the body
        speed, moves = _begin(w, rows[i], goes_on, arm[i])
        fastest, moving = max(fastest, speed), moving or moves
    head[HEAD.speed] = fastest
    head[HEAD.still], head[HEAD.moves] = not moving, moving and setting(w, SETTING.surfaces) == _MEETS


@kernel
def aim_surfaces(w):
    """Move the bodies to their poses at the end of the step."""
    rows, m = _rows(w), size(w, MODEL.nmocap)
    position, quaternion = data_floats(w, DATA.mocap_pos, 3 * m), data_floats(w, DATA.mocap_quat, 4 * m)
    for i in range(m):
        put(position[3 * i : 3 * i + 3], rows[i, ROW.to : ROW.to + 3])
        put(quaternion[4 * i : 4 * i + 4], rows[i, ROW.to + 3 : ROW.through])


@kernel
def place_surfaces(w):
    """Move the bodies to their poses in the middle of the step."""
    head, rows, m, h = _head(w), _rows(w), size(w, MODEL.nmocap), w.timestep
    if head[HEAD.still] != 0.0:
        return
    s = (head[HEAD.began] + 0.5 * h - head[HEAD.began]) / h
    first, last, mean = s * (1 - s) ** 2, s * s * (s - 1), s * s * (3 - 2 * s)
    position, quaternion = data_floats(w, DATA.mocap_pos, 3 * m), data_floats(w, DATA.mocap_quat, 4 * m)
    moved, quat = numbers(6), numbers(4)
    for i in range(m):
        row = rows[i]
        for k in range(6):
            moved[k] = h * (first * row[ROW.first + k] + last * row[ROW.end + k] + mean * row[ROW.through + k])
        for k in range(3):
            position[3 * i + k] = row[ROW.start + k] + moved[k]
        axis = moved[3:]
        angle = length(axis)
        for k in range(3 if angle > 0.0 else 0):
            axis[k] /= angle
        mj.axis_angle_to_quat(address_of(quat), address_of(axis), angle)
        mj.mul_quat(address_of(quaternion) + 32 * i, address_of(quat), address_of(row) + 8 * (ROW.start + 3))


@kernel
def speeds_of_middle(w):
    """Find the velocities of the bodies in the middle of the step; the time of data is its end."""
    head, rows, h = _head(w), _rows(w), w.timestep
    s = (_time(w) - 0.5 * h - head[HEAD.began]) / h
    first, last, mean = (1 - s) * (1 - 3 * s), s * (3 * s - 2), 6 * s * (1 - s)
    for i in range(len(rows)):
        row = rows[i]
        for k in range(6):
            row[ROW.now + k] = first * row[ROW.first + k] + last * row[ROW.end + k] + mean * row[ROW.through + k]


@kernel
def end_surfaces(w):
    """Store the end of this step as the start of the next one."""
    head, rows = _head(w), _rows(w)
    head[HEAD.time] = _time(w)
    for i in range(len(rows)):
        row = rows[i]
        put(row[ROW.target : ROW.mean], row[ROW.to : ROW.through])
        put(row[ROW.mean : ROW.last], row[ROW.through : ROW.first])
        put(row[ROW.last : ROW.start], row[ROW.end : ROW.now])


@kernel
def velocities_of(w, at):
    """Return velocities of the bodies, by their place in `Row`, (nmocap, 6), or (0, 6) if the bodies do not move."""
    return _rows(w)[: size(w, MODEL.nmocap) if w.surfaces != 0 else 0, at : at + 6]


@plain
def surface_speed(w):
    """Return the largest speed of a point of a moving surface, m/s."""
    return 0.0 if w.surfaces == 0 else float_at(w.surfaces + 8 * HEAD.speed)


@plain
def surfaces_move(w):
    """Return whether any mocap body that can meet others moves in this step."""
    return w.surfaces != 0 and float_at(w.surfaces + 8 * HEAD.moves) != 0.0
