"""Reference trajectories of the scenes in models/: closed forms, reduced equations of motion, or converged runs.

Each function returns the smooth pieces of the trajectory up to `duration`. The closed forms and the reduced equations
do not use the package. The billiard break, whose balls move straight, uses rigid stepping with a tighter tolerance.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from scipy.special import ellipj, ellipk

from impactlaw import Stepper
from impactlaw.models import load

from .graph_distance import Arc

G = 9.81
_LONGEST = 0.02  # s, longest step of the reduced equations, so that interpolation keeps the integrator's digits

_SPACING = 0.004  # s, spacing of the knots of an interpolated piece

Field = Callable[[float, np.ndarray], np.ndarray]


def bouncing_ball(duration: float, tolerance: float, height: float = 1.0) -> list[Arc]:
    """Return parabolas between impacts that halve the speed, from a height in m; exact for any tolerance."""
    del tolerance
    arcs: list[Arc] = []
    begin, speed = 0.0, 0.0
    while begin < duration:
        end = begin + (speed + math.sqrt(speed**2 + 2 * G * height)) / G

        def state(t: np.ndarray, begin: float = begin, height: float = height, speed: float = speed) -> np.ndarray:
            s = t - begin
            return np.column_stack([height + speed * s - 0.5 * G * s**2, speed - G * s])

        arcs.append(Arc(begin, min(end, duration), state))
        begin, height, speed = end, 0.0, 0.5 * (G * (end - begin) - speed)
    return arcs


def _pendulum_rate() -> float:
    """Return sqrt(m g L / I) of a ball of the cradle, rad/s."""
    return math.sqrt(G / (1.0 + 0.4 * 0.125**2))


def cradle_reversal(duration: float, tolerance: float) -> list[Arc]:
    """Return swings of the last and the first ball in turn, by elliptic functions; exact for any tolerance.

    ``q'' = -r^2 sin q`` from ``q = 0, q' = w`` has the solution ``q = 2 asin(k sn(r t, k))`` with ``k = w / (2 r)``,
    which is back at q = 0 after ``2 K(k) / r`` with ``q' = -w``.
    """
    del tolerance
    rate = _pendulum_rate()
    k = 0.5 / rate
    swing = 2 * ellipk(k * k) / rate
    arcs: list[Arc] = []
    begin, ball, sign = 0.0, 4, 1.0
    while begin < duration:

        def state(t: np.ndarray, begin: float = begin, ball: int = ball, sign: float = sign) -> np.ndarray:
            sn, cn, _, _ = ellipj(rate * (t - begin), k * k)
            found = np.zeros((len(t), 10))
            found[:, ball] = sign * 2 * np.arcsin(k * sn)
            found[:, 5 + ball] = sign * 2 * k * rate * cn
            return found

        arcs.append(Arc(begin, min(begin + swing, duration), state))
        begin, ball, sign = begin + swing, 4 - ball, -sign
    before = Arc(0.0, 0.0, lambda t: np.tile(np.eye(10)[5], (len(t), 1)))  # the first ball, just before it hits
    return [before, *arcs]


def cradle_moreau(duration: float, tolerance: float) -> list[Arc]:
    """Return the motion of two pendulums, the first ball and the other four together, that collide elastically.

    Moreau's law with e = 1 gives the four balls one velocity: ``v+ = 2 p - v-``, where p is the common velocity.
    """
    rate = _pendulum_rate()

    def field(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], -(rate**2) * np.sin(y[:2])])

    def embed(y: np.ndarray) -> np.ndarray:
        return y[:, [0, 1, 1, 1, 1, 2, 3, 3, 3, 3]]

    def collide(y: np.ndarray) -> np.ndarray:
        common = (y[2] + 4 * y[3]) / 5
        return np.array([y[0], y[0], 2 * common - y[2], 2 * common - y[3]])

    def closing(_: float, y: np.ndarray) -> float:
        return y[0] - y[1]

    start = np.array([0.0, 0.0, 1.0, 0.0])
    before = Arc(0.0, 0.0, lambda t: np.tile(embed(start[None])[0], (len(t), 1)))
    return [before, *_flights(field, collide(start), closing, collide, embed, (0.0, duration), tolerance)]


def falling_rod(duration: float, tolerance: float) -> list[Arc]:
    """Return the fall of the rod, then its rotation about the right end, which stays down, while the left end bounces.

    With ``z = sin q`` the equation of motion is ``(cos^2 q + 1/3) q'' = cos q (sin q q'^2 - 1)``; an impact of the left
    end reverses q'.
    """

    def fall(t: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(t)
        return np.column_stack([0.5 - 0.5 * t**2, zero, -t, zero])

    def held(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.sin(q), np.cos(q), -np.sin(q)

    def collide(y: np.ndarray) -> np.ndarray:
        return np.array([0.0, -y[1]])

    field, embed = _on_one_foot(held, inertia=1 / 3, gravity=1.0)
    start, span = np.array([0.0, 0.5]), (1.0, duration)
    return [Arc(0.0, 1.0, fall), *_flights(field, start, lambda _, y: -y[0], collide, embed, span, tolerance)]


def rocking_block(duration: float, tolerance: float) -> list[Arc]:
    """Return the rotations of the block about one foot, then about the other; each change multiplies q' by 7/10."""
    arcs: list[Arc] = []
    begin, y, side = 0.0, np.array([0.125, 0.0]), 1.0
    while begin < duration:

        def closing(_: float, y: np.ndarray, side: float = side) -> float:
            return -side * y[0]

        field, embed = _on_one_foot(partial(_block_height, side), inertia=(0.25**2 + 1) / 12, gravity=G)
        arc, y = flight(field, y, closing, embed, (begin, duration), tolerance)
        arcs.append(arc)
        begin, side, y = arc.end, -side, np.array([0.0, 0.7 * y[1]])
    return arcs


def _block_height(side: float, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the height above the upright position, at the angle q on the foot of this side, and two derivatives."""
    s, c = side * 0.125 * np.sin(q), side * 0.125 * np.cos(q)
    return s + 0.5 * np.cos(q) - 0.5, c - 0.5 * np.sin(q), -s - 0.5 * np.cos(q)


def billiard_break(duration: float, tolerance: float) -> list[Arc]:
    """Return straight flights between the collisions of rigid stepping with a gap tolerance of 100 tolerances, m.

    MuJoCo's integrators are exact on straight flights, so that only the times of collisions have errors.
    """
    model, data = load("billiard_rack")
    model.opt.timestep = duration / 400
    stepper = Stepper(model, "scene", gap_tolerance=1e2 * tolerance)
    arcs: list[Arc] = []
    begin, q, v = 0.0, data.qpos.copy(), data.qvel.copy()
    for _ in range(400):
        stepper.step(data)
        for event in stepper.events:
            arcs.append(_straight(begin, event.time, q, v))
            begin, q, v = event.time, event.qpos.copy(), event.impact.post_velocity.copy()
    return [*arcs, _straight(begin, duration, q, v)]


def _straight(begin: float, end: float, q: np.ndarray, v: np.ndarray) -> Arc:
    def state(t: np.ndarray) -> np.ndarray:
        return np.hstack([q + np.outer(t - begin, v), np.tile(v, (len(t), 1))])

    return Arc(begin, end, state)


def _on_one_foot(
    height: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]], *, inertia: float, gravity: float
) -> tuple[Field, Callable[[np.ndarray], np.ndarray]]:
    """Return the equation of motion of a unit mass whose height f is a function of its angle q, and its embedding.

    ``(f'^2 + I) q'' + f' f'' q'^2 + g f' = 0``; the embedding maps (q, q') to (f, q, f' q', q').
    """

    def field(_: float, y: np.ndarray) -> np.ndarray:
        slope, bend = height(y[0])[1:]
        return np.array([y[1], -(slope * bend * y[1] ** 2 + gravity * slope) / (slope**2 + inertia)])

    def embed(y: np.ndarray) -> np.ndarray:
        f, slope, _ = height(y[:, 0])
        return np.column_stack([f, y[:, 0], slope * y[:, 1], y[:, 1]])

    return field, embed


def _flights(
    field: Field,
    start: np.ndarray,
    closing: Callable[[float, np.ndarray], float],
    collide: Callable[[np.ndarray], np.ndarray],
    embed: Callable[[np.ndarray], np.ndarray],
    span: tuple[float, float],
    tolerance: float,
) -> list[Arc]:
    """Integrate from collision to collision; a collision is an upward zero crossing of `closing`."""
    arcs: list[Arc] = []
    begin, y = span[0], start
    while not arcs or not math.isclose(arcs[-1].end, span[1], rel_tol=1e-12):
        arc, y = flight(field, y, closing, embed, (begin, span[1]), tolerance)
        arcs.append(arc)
        begin, y = arc.end, collide(y)
    return arcs


def flight(
    field: Field,
    start: np.ndarray,
    closing: Callable[[float, np.ndarray], float],
    embed: Callable[[np.ndarray], np.ndarray],
    span: tuple[float, float],
    tolerance: float,
    *,
    spacing: float = _SPACING,
) -> tuple[Arc, np.ndarray]:
    """Integrate up to the next collision or the end of the span; return this piece and the state at its end.

    A collision is an upward zero crossing of `closing`. The piece is interpolated between knots with this spacing, s.
    """

    def event(t: float, y: np.ndarray) -> float:
        return closing(t, y)

    event.terminal, event.direction = True, 1.0  # pyright: ignore[reportFunctionMemberAccess]
    found = solve_ivp(
        field, span, start, method="DOP853", rtol=tolerance, atol=1e-2 * tolerance, dense_output=True, events=event,
        max_step=_LONGEST,
    )  # fmt: skip
    end = float(found.t[-1])
    times = np.linspace(span[0], end, max(16, math.ceil((end - span[0]) / spacing)))
    spline = make_interp_spline(times, embed(found.sol(times).T), k=7)  # keeps the digits, and is faster to evaluate
    return Arc(span[0], end, spline), found.y[:, -1]
