"""Surfaces with a prescribed motion: mocap bodies, and geoms whose surface runs like a belt.

In MuJoCo a mocap body has no velocity: its pose is set between steps, and jumps. Here it moves during a step, from the
pose of the last step to the one that is set now, and its contacts have ``gamma = J v + w``. Let u be its mean velocity
in this step and u' that in the step before. Its velocity is a parabola in time, from the velocity at the end of the
last step to ``(3 u - u') / 2``. This is continuous, with an error of the order of the square of the time step. If u and
u' differ by more than `BLOW`, the body was struck: it moves at constant velocity u, and ``w- != w+`` at the start of
the step. A body that would move farther in a step than its size, and faster than `PUT`, was put somewhere else: it is
at rest in its new place.

The ``surfacevel`` of a geom moves its surface within itself. As in MuJoCo it acts in the tangent plane of a contact and
about its normal only, through sliding and torsional friction, and never pushes. If no geom has a ``surfacevel`` when
the model is compiled, MuJoCo ignores values that are written into the compiled model later.
"""

from __future__ import annotations

import copy
from math import sqrt
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.scene.contacts import Contacts
from impactlaw.scene.tolerances import BLOW, PUT, meter

TORSION = 2
"""Kind of a torsional row; the kinds of friction rows are two of sliding, one of torsion, two of rolling."""
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]  # for each of the axes x, y, z, the next one and the one before


class Motion(NamedTuple):
    """The prescribed motion of the second surface of each contact, relative to the first."""

    velocity: np.ndarray  # of mocap bodies at the contact point, world frame, m/s, (h, 3)
    spin: np.ndarray  # angular velocity of mocap bodies, world frame, rad/s, (h, 3)
    belt: np.ndarray  # velocity of surfaces that run like belts, world frame, m/s, (h, 3)
    belt_spin: np.ndarray  # angular velocity of these surfaces, world frame, rad/s, (h, 3)

    def along(self, axis: np.ndarray, contact: np.ndarray, kind: np.ndarray) -> np.ndarray:
        """Return the contribution to the velocities of friction rows, m/s or rad/s, (k,), with these axes, (k, 3).

        The kind is 0 or 1 for sliding, 2 for torsion, larger for rolling, int (k,).
        """
        slides, twists = (kind < TORSION)[:, None], (kind == TORSION)[:, None]
        spin = self.spin[contact] + np.where(twists, self.belt_spin[contact], 0.0)
        return np.vecdot(axis, np.where(slides, (self.velocity + self.belt)[contact], spin))


class LastMotion(NamedTuple):
    """The motion of mocap bodies in the last step."""

    time: float  # when the step ended, s; NaN if there was no step
    target: np.ndarray  # poses at its end, (nmocap, 7)
    mean: np.ndarray  # mean velocities, (nmocap, 6)
    last: np.ndarray  # velocities at its end, (nmocap, 6)


class Surfaces:
    """The moving surfaces of one scene.

    Attributes:
        meet: whether mocap bodies can touch other bodies.
        carrier: the mocap body that carries each geom that can touch others, else -1, int32 (ngeom,).
        arm: how far these geoms reach from their mocap bodies, m, (nmocap,).
        run: whether surfaces may run like belts.
        still: whether no mocap body moves in this step or moved at the end of the step before.
        goes_on: whether velocities at the start of this step equal those at the end of the step before.
    """

    def __init__(self, model: mujoco.MjModel, geoms: np.ndarray):
        self._model, self._meter = model, meter(model.opt.gravity)
        mocap = model.body_mocapid[model.body_rootid[model.geom_bodyid]]
        self._mocap = np.append(mocap, -1)  # limits have geom -1
        used = np.unique(mocap[np.unique(geoms)]) if len(geoms) else np.zeros(0, dtype=int)
        self.meet = bool((used >= 0).any())
        self.run = bool(model.flg_surfacevel) and len(geoms) > 0
        self.carrier = np.full(model.ngeom, -1, np.int32)
        meeting = np.unique(geoms[np.isfinite(model.geom_rbound[geoms])]) if self.meet else np.zeros(0, dtype=int)
        self.carrier[meeting] = mocap[meeting]
        self._measured: list[bytes] = []
        self._pose = b""  # poses before the last step of which `stay` was asked
        self._measure()
        self._time, self._duration = np.nan, 1.0
        self._start = self._target = np.zeros((model.nmocap, 7))
        self._before = self._mean = self._first = self._last = np.zeros((model.nmocap, 6))
        self.still = self.goes_on = False

    @property
    def move(self) -> bool:
        """Whether mocap bodies that can touch others move in this step."""
        return self.meet and not self.still

    def _measure(self) -> None:
        """Compute how far geoms reach, if the model has changed since the last time."""
        model = self._model
        seen = [field.tobytes() for field in (model.geom_rbound, model.geom_pos, model.body_pos)]
        if seen == self._measured:
            return
        self._measured, self.arm = seen, np.zeros(model.nmocap)
        for geom in np.flatnonzero(self.carrier >= 0).tolist():
            body = self.carrier[geom]
            self.arm[body] = max(self.arm[body], self._distance(geom))

    def _distance(self, geom: int) -> float:
        """Return how far a geom reaches from its mocap body, m, if joints between them do not move."""
        model = self._model
        reach, body = model.geom_rbound[geom] + np.linalg.norm(model.geom_pos[geom]), model.geom_bodyid[geom]
        while model.body_mocapid[body] < 0:
            reach, body = reach + np.linalg.norm(model.body_pos[body]), model.body_parentid[body]
        return float(reach)

    def _aim(self, data: mujoco.MjData) -> np.ndarray:
        """Return the poses in data, (nmocap, 7)."""
        target = np.empty_like(self._target)
        target[:, :3], target[:, 3:] = data.mocap_pos, data.mocap_quat
        for quat in target[:, 3:]:
            mujoco.mju_normalize4(quat)  # as MuJoCo does when it places the body
        return target

    def begin(self, data: mujoco.MjData, duration: float) -> None:
        """Begin a step of this duration, s, in which bodies move to the poses in data from those of the last step.

        If the last step did not end at the current time, they are at rest.
        """
        if self.meet:
            self._measure()
        target = self._aim(data)
        self.goes_on = going_on = self._time == data.time
        self._time, self._duration = data.time, duration
        if going_on and self.still and target.tobytes() == self._target.tobytes():
            return
        put = ~self._can_go(target, duration) if going_on else np.ones(len(target), dtype=bool)
        start = np.where(put[:, None], target, self._target)
        mean = np.zeros_like(self._mean)
        mean[:, :3] = (target[:, :3] - start[:, :3]) / duration
        turned = target[:, 3:] != start[:, 3:]
        for i in np.flatnonzero(turned.any(axis=1)) if np.count_nonzero(turned) else ():
            turn = np.zeros(3)
            mujoco.mju_subQuat(turn, target[i, 3:], start[i, 3:])
            mujoco.mju_rotVecQuat(mean[i, 3:], turn / duration, start[i, 3:])
        known = np.where(put[:, None], mean, self._mean)
        struck = np.array(self._speeds(mean - known)) > BLOW * self._meter
        self._before = self._first = np.where(put[:, None], mean, self._last)
        self._last = 1.5 * mean - 0.5 * known
        if np.count_nonzero(struck):
            self.goes_on = False
            self._first = np.where(struck[:, None], mean, self._first)
            self._last = np.where(struck[:, None], mean, self._last)
        self._start, self._target, self._mean = start, target, mean
        self.still = not any(map(np.count_nonzero, (self._before, self._first, self._last, mean)))

    def stay(self, data: mujoco.MjData) -> bool:
        """Return whether no mocap body moves in the step that begins now; if so, begin it.

        Nor do they move in steps that follow until somebody sets other poses.
        """
        pose = data.mocap_pos.tobytes() + data.mocap_quat.tobytes()
        same, self._pose = pose == self._pose, pose
        if self._time == data.time:
            return self.still and same
        self.begin(data, 1.0)
        return True

    def forget(self) -> None:
        """Take the next step as a start: the bodies are at rest where they are then."""
        self._time = np.nan

    def _can_go(self, target: np.ndarray, duration: float) -> np.ndarray:
        """Return which bodies move to poses (nmocap, 7) in a step of this duration, s, instead of being put there."""
        far = np.linalg.norm(target[:, :3] - self._target[:, :3], axis=1)
        return far <= np.maximum(2.0 * self.arm, PUT * self._meter * duration)

    def _speeds(self, velocity: np.ndarray) -> list[float]:
        """Return a bound on the speed of any point of each body at velocities (nmocap, 6), m/s.

        Plain Python is fast here, since most scenes have one mocap body.
        """
        return [
            sqrt(x * x + y * y + z * z) + arm * sqrt(p * p + q * q + r * r)
            for (x, y, z, p, q, r), arm in zip(velocity.tolist(), self.arm.tolist(), strict=True)
        ]

    @property
    def last_motion(self) -> LastMotion:
        """The motion of mocap bodies in the last step that has ended."""
        return LastMotion(self._time, self._target, self._mean, self._last)

    def go_on(self, motion: LastMotion) -> None:
        """Continue the next step from another last motion."""
        self._time, self._target, self._mean, self._last = motion
        self.still = False

    def from_here(self, data: mujoco.MjData) -> Surfaces:
        """Return a copy for which the last step has ended now, with the current poses and velocities."""
        here = copy.copy(self)
        here._time, here._target = data.time, np.hstack([data.mocap_pos, data.mocap_quat])
        here._mean = here._last = self._before if data.time == self._time else self._now(data)
        return here

    def end(self, data: mujoco.MjData) -> None:
        """End the step now, with its target poses."""
        self._put(data)
        self.end_there(data)

    def end_there(self, data: mujoco.MjData) -> None:
        """End the step now; the bodies are in their target poses."""
        self._time = data.time

    def aim(self, data: mujoco.MjData) -> None:
        """Put the bodies in their poses at the end of the step, where MuJoCo has them during the whole step."""
        if not self.still:  # else they are there
            self._put(data)

    def _put(self, data: mujoco.MjData) -> None:
        data.mocap_pos[:], data.mocap_quat[:] = self._target[:, :3], self._target[:, 3:]

    def place(self, data: mujoco.MjData) -> None:
        """Put the bodies in their poses at the current time."""
        if self.still:  # they are there
            return
        s = (data.time - self._time) / self._duration
        if s >= 1.0 - 1e-9:
            self._put(data)
            return
        first, last, mean = s * (1 - s) ** 2, s * s * (s - 1), s * s * (3 - 2 * s)
        moved = self._duration * (first * self._first + last * self._last + mean * self._mean)
        quat = np.empty(4)
        for i, start in enumerate(self._start):
            data.mocap_pos[i] = start[:3] + moved[i, :3]
            angle = float(np.linalg.norm(moved[i, 3:]))
            mujoco.mju_axisAngle2Quat(quat, moved[i, 3:] / angle if angle > 0 else np.array([1.0, 0.0, 0.0]), angle)
            turned = np.empty(4)
            mujoco.mju_mulQuat(turned, quat, start[3:])
            data.mocap_quat[i] = turned

    def jumps(self, data: mujoco.MjData) -> bool:
        """Whether data is at the start of a step at which the velocity of surfaces jumps."""
        return data.time == self._time and self._first is not self._before

    @property
    def middle_velocity(self) -> np.ndarray:
        """Velocities of mocap bodies in the middle of this step, (nmocap, 6)."""
        return 1.5 * self._mean - 0.25 * (self._first + self._last)

    @property
    def speed(self) -> float:
        """A bound on the speed of any point of a moving surface in this step, m/s."""
        if self.still:
            return 0.0
        ends = (self._first, self._last, self.middle_velocity)
        return max(max(self._speeds(velocity), default=0.0) for velocity in ends)

    def _now(self, data: mujoco.MjData) -> np.ndarray:
        s = (data.time - self._time) / self._duration
        first, last, mean = (1 - s) * (1 - 3 * s), s * (3 * s - 2), 6 * s * (1 - s)
        return first * self._first + last * self._last + mean * self._mean

    def drift(self, data: mujoco.MjData, contacts: Contacts, *, before: bool = False) -> np.ndarray:
        """Return ``w`` of these contacts, m/s, (h,), now or, with ``before``, from velocities before the step."""
        velocity, _ = self._relative(data, contacts, self._before if before else self._now(data))
        return np.vecdot(contacts.normal, velocity)

    def motion(self, data: mujoco.MjData, contacts: Contacts) -> Motion:
        """Return how the surfaces of these contacts move."""
        velocity, spin = self._relative(data, contacts, self._now(data))
        belt, belt_spin = np.zeros_like(velocity), np.zeros_like(velocity)
        if self.run:
            belts = np.append(self._model.geom_surfacevel.any(axis=1), False)
            for sign, geom in ((-1.0, contacts.geoms[:, 0]), (1.0, contacts.geoms[:, 1])):
                for i in np.flatnonzero(belts[geom]):
                    own = self._belt(data, int(geom[i]), contacts.position[i])
                    belt[i], belt_spin[i] = belt[i] + sign * own[0], belt_spin[i] + sign * own[1]
        return Motion(velocity, spin, belt, belt_spin)

    def _belt(self, data: mujoco.MjData, geom: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the velocity and angular velocity of a running surface at a point, world frame, (3,) each."""
        own, turn = self._model.geom_surfacevel[geom], data.geom_xmat[geom].reshape(3, 3)
        spin = turn @ own[3:]
        return turn @ own[:3] + np.cross(spin, point - data.geom_xpos[geom]), spin

    def _relative(self, data: mujoco.MjData, contacts: Contacts, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        linear, spin = np.zeros((2, len(contacts), 3))
        for sign, geom in ((-1.0, contacts.geoms[:, 0]), (1.0, contacts.geoms[:, 1])) if self.move else ():
            body = self._mocap[geom]
            on = np.flatnonzero(body >= 0)
            if not len(on):
                continue
            moves, arm = velocity[body[on]], contacts.position[on] - data.mocap_pos[body[on]]
            w = moves[:, 3:]
            turning = w[:, _NEXT] * arm[:, _LAST] - w[:, _LAST] * arm[:, _NEXT]  # w x arm; np.cross is ten times slower
            linear[on] += sign * (moves[:, :3] + turning)
            spin[on] += sign * w
        return linear, spin
