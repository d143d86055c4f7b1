"""Scenes with hundreds of degrees of freedom: a row of dominoes, and a house of cards that stands or is kicked over."""

from collections.abc import Callable

import mujoco
import numpy as np

_DOMINOES = 80  # number
_DOMINO = np.array([0.004, 0.012, 0.024])  # half sizes, m
_SPACING = 0.022
_PUSH = 4.0  # rad/s, of the first domino about its lower edge

_STORIES = 7
_CARD = np.array([0.044, 0.0315, 0.001])  # half length, half width, half thickness, m
_LEAN = np.deg2rad(18.0)
_SLIT = 1e-3  # m, gap between cards that lie end to end
_KICK = 1.0  # m/s


def dominoes() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a row of free-standing dominoes; the first one turns about its lower edge."""
    spec = _ground(friction=0.5)
    for i in range(_DOMINOES):
        _box(spec, _DOMINO, [i * _SPACING, 0.0, _DOMINO[2]], 0.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[[0, 2, 4]] = _PUSH * _DOMINO[2], -_PUSH * -_DOMINO[0], _PUSH
    return model, data


def cards() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a house of cards: pairs that lean on each other, and cards that lie across their tops."""
    spec = _ground(friction=0.8)
    length, _, thick = _CARD
    apart = length * np.sin(_LEAN) + thick * np.cos(_LEAN)  # from a leaning card's center to the line where both meet
    half = length * np.cos(_LEAN) + thick * np.sin(_LEAN)
    pitch = 2.0 * length + _SLIT
    floor = 0.0
    for story in range(_STORIES):
        tops = pitch * (np.arange(_STORIES - story) - 0.5 * (_STORIES - story - 1))
        for x in tops:
            for side in (-1.0, 1.0):
                _box(spec, _CARD, [x + side * apart, 0.0, floor + half], side * (0.5 * np.pi - _LEAN))
        floor += 2.0 * half
        for x in 0.5 * (tops[:-1] + tops[1:]):
            _box(spec, _CARD, [x, 0.0, floor + thick], 0.0)
        floor += 2.0 * thick
    model = spec.compile()
    return model, mujoco.MjData(model)


def kicked_cards() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the house of cards with its first card kicked outwards."""
    model, data = cards()
    data.qvel[0] = -_KICK
    return model, data


def _ground(friction: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.default.geom.friction[0] = friction
    spec.default.geom.density = 500.0
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05])
    return spec


def _box(spec: mujoco.MjSpec, half: np.ndarray, pos: list[float], turn: float) -> None:
    """Add a free box, turned about the y axis."""
    body = spec.worldbody.add_body(pos=pos, quat=[np.cos(0.5 * turn), 0.0, np.sin(0.5 * turn), 0.0])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half)


SCENES: dict[str, Callable[[], tuple[mujoco.MjModel, mujoco.MjData]]] = {
    "dominoes": dominoes,
    "cards": cards,
    "cards kicked": kicked_cards,
}
