"""Reference trajectories of the scenes with friction, by a closed form and reduced equations, without a stepper."""

from collections.abc import Callable

import mujoco
import numpy as np

from .graph_distance import Arc
from .references import G, flight
from .scenes_friction import FOOT, FRICTION, HALF_LENGTH, LEGS, ROD_FRICTION, ROD_START, SPEED, TIP, quadruped

_FINE = 0.001  # s, spacing of the knots of the quadruped, whose servos are stiff
_LOOSER = 100  # factor of the tolerance of the quadruped's equations, given the accuracy of MuJoCo's functions
_INERTIA = 1 / 12  # of the rod, kg m^2


def sliding_block(duration: float, tolerance: float) -> list[Arc]:
    """Return the slide, which ends after v^2 / (2 mu g), and the rest afterwards; exact for any tolerance."""
    del tolerance
    slowing = FRICTION * G
    end = SPEED / slowing

    def slide(t: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(t)
        return np.column_stack([SPEED * t - 0.5 * slowing * t**2, zero, zero, SPEED - slowing * t, zero, zero])

    return [Arc(0.0, end, slide), _resting(end, duration, [0.5 * SPEED**2 / slowing, 0.0, 0.0])]


def rod(duration: float, tolerance: float) -> list[Arc]:
    """Return the fall, the rotation about a tip that sticks and slips in turn, and the rest afterwards.

    With the lower tip down, ``z = a sin q``, the remaining coordinates are x and q. The forces F along the floor and N
    normal to it follow from ``gap'' = 0`` and from either a constant velocity of the tip (it rolls) or ``F = -+ mu N``
    (it slips). The impulses are checked: the tip sticks in the first impact, and the rod stops in the second.
    """
    a, mu = HALF_LENGTH, ROD_FRICTION
    x, height, q, speed, _, _ = ROD_START
    end = float(np.sqrt(2 * (height - a * np.sin(q)) / G))

    def fall(t: np.ndarray) -> np.ndarray:
        one, zero = np.ones_like(t), np.zeros_like(t)
        return np.column_stack([x + speed * t, height - 0.5 * G * t**2, q * one, speed * one, -G * t, zero])

    J = _tip(q)
    velocity = np.array([speed, -G * end, 0.0])
    impulse = np.linalg.solve(_delassus(J), -J @ velocity)
    _check(abs(impulse[0]) <= mu * impulse[1], "the tip sticks when it lands")
    velocity += [1.0, 1.0, 1 / _INERTIA] * (impulse @ J)
    arcs, slips = [Arc(0.0, end, fall)], 0.0
    y = np.array([x + speed * end, q, velocity[0], velocity[2]])
    while y[1] > 1e-12 and arcs[-1].end < duration:
        if slips == 0.0:
            F, N = _forces(y, 0.0)
            slips = -np.sign(F) if abs(F) >= (1 - 1e-9) * mu * N else 0.0

        def field(_: float, y: np.ndarray, slips: float = slips) -> np.ndarray:
            F = _forces(y, slips)
            return np.array([y[2], y[3], F[0], F @ _tip(y[1])[:, 2] / _INERTIA])

        def closing(_: float, y: np.ndarray, slips: float = slips) -> float:
            F, N = _forces(y, slips)
            return max(-y[1], -slips * float(_tip(y[1])[0, [0, 2]] @ y[2:]) if slips else abs(F) - mu * N)

        arc, y = flight(field, y, closing, _embed, (arcs[-1].end, duration), tolerance)
        arcs.append(arc)
        slips = 0.0
    _check(abs(y[2]) <= mu * a * abs(y[3]), "the rod stops when its other tip lands")
    return [*arcs, _resting(arcs[-1].end, duration, [y[0], 0.0, 0.0])]


def _tip(q: float) -> np.ndarray:
    """Return the tangential and the normal row of the contact of the lower tip, (2, 3)."""
    a = HALF_LENGTH
    return np.array([[1.0, 0.0, -a * np.sin(q) - TIP], [0.0, 1.0, -a * np.cos(q)]])


def _delassus(J: np.ndarray) -> np.ndarray:
    return (J * [1.0, 1.0, 1 / _INERTIA]) @ J.T


def _forces(y: np.ndarray, slips: float) -> np.ndarray:
    """Return the forces F and N of a tip that slips to the right (1) or to the left (-1), or rolls (0), (2,)."""
    J, bend = _tip(y[1]), HALF_LENGTH * y[3] ** 2
    if slips == 0.0:
        return np.linalg.solve(_delassus(J), np.array([bend * np.cos(y[1]), G - bend * np.sin(y[1])]))
    direction = np.array([-slips * ROD_FRICTION, 1.0])
    return direction * (G - bend * np.sin(y[1])) / (direction @ _delassus(J)[1])


def _embed(y: np.ndarray) -> np.ndarray:
    a = HALF_LENGTH
    x, q, speed, spin = y.T
    return np.column_stack([x, a * np.sin(q), q, speed, a * np.cos(q) * spin, spin])


def quadruped_landing(duration: float, tolerance: float) -> list[Arc]:
    """Return the fall, and the motion afterwards with all feet held without slip by forces of least norm.

    The equations of motion are MuJoCo's without contacts; feet roll. The impulses and forces are checked: no foot slips
    or lifts off, in the impact or afterwards. The motion is planar, so that rotation vectors are angles.
    """
    tolerance *= _LOOSER
    model, data = quadruped()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    nv, ball = model.nv, slice(3, 6)

    def place(y: np.ndarray) -> None:
        data.qpos[:3], data.qpos[7:] = y[:3], y[6:nv]
        mujoco.mju_axisAngle2Quat(data.qpos[3:7], [0.0, 1.0, 0.0], y[4])
        data.qvel[:] = y[nv:]

    def acceleration(y: np.ndarray, held: bool) -> tuple[np.ndarray, np.ndarray]:
        place(y)
        mujoco.mj_forward(model, data)
        if not held:
            return data.qacc.copy(), np.zeros(0)
        J, drift = _feet(model, data)
        change, forces = _hold(model, data, J, J @ data.qacc + drift)
        return data.qacc + change, forces

    def field(held: bool) -> Callable[[float, np.ndarray], np.ndarray]:
        return lambda _, y: np.concatenate([y[nv:], acceleration(y, held)[0]])

    def landing(_: float, y: np.ndarray) -> float:
        place(y)
        mujoco.mj_kinematics(model, data)
        return FOOT - float(min(data.geom(name).xpos[2] for name in LEGS))

    start = np.concatenate([data.qpos[:3], np.zeros(3), data.qpos[7:], data.qvel])
    fall, y = flight(field(False), start, landing, lambda y: y, (0.0, duration), tolerance, spacing=_FINE)
    acceleration(y, False)
    J, _ = _feet(model, data)
    change, impulse = _hold(model, data, J, J @ y[nv:])
    _check_cones(impulse)
    y[nv:] += change
    stand, _ = flight(field(True), y, lambda _, y: -1.0, lambda y: y, (fall.end, duration), tolerance, spacing=_FINE)
    for t in np.linspace(fall.end, duration, 500):
        state = stand.state(np.array([t]))[0]
        _check(bool(np.abs(state[ball][[0, 2]]).max() < 1e-9), "the quadruped moves in a plane")
        _check_cones(acceleration(state, True)[1])
    return [fall, stand]


def _feet(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return the Jacobian rows of the feet's contact points, (12, nv), and the rates of change of the rows times v."""
    J, drift = [], []
    for name in LEGS:
        geom, body = model.geom(name).id, int(model.geom(name).bodyid[0])
        p, r = np.zeros((2, 3, model.nv))
        mujoco.mj_jacGeom(model, data, p, r, geom)
        J.append(p + FOOT * np.array([-r[1], r[0], np.zeros(model.nv)]))
        mujoco.mj_jacDot(model, data, p, r, data.geom_xpos[geom], body)
        drift.append((p + FOOT * np.array([-r[1], r[0], np.zeros(model.nv)])) @ data.qvel)
    return np.vstack(J), np.concatenate(drift)


def _hold(
    model: mujoco.MjModel, data: mujoco.MjData, J: np.ndarray, rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the change of velocity or acceleration that cancels these rates of the feet, and the forces it needs."""
    solved = np.zeros_like(J)
    mujoco.mj_solveM(model, data, solved, J)
    forces = np.linalg.lstsq(J @ solved.T, -rates, rcond=1e-10)[0]
    return solved.T @ forces, forces


def _check_cones(forces: np.ndarray) -> None:
    tangential, normal = np.linalg.norm(forces.reshape(-1, 3)[:, :2], axis=1), forces[2::3]
    _check(bool((tangential < normal).all()), "no foot of the quadruped slips")  # its coefficient of friction is 1


def _resting(begin: float, end: float, q: list[float]) -> Arc:
    return Arc(begin, end, lambda t: np.tile([*q, *np.zeros(len(q))], (len(t), 1)))


def _check(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(f"the reference rests on this, which is not so: {what}")
