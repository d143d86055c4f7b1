"""Contacts, gap gradients and inertia out of MuJoCo: the one file that knows MuJoCo's array conventions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from impactlaw.collision import Collision
from impactlaw.errors import SceneError
from impactlaw.geoms import SKIN, several_contacts, touching_distance
from impactlaw.metric import KineticMetric

GAP_TOLERANCE = 1e-9
"""Gap, in m, up to which a contact counts as closed."""

_OVERRIDE = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
_SINGLE = int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
_FULL = int(mujoco.mjtWarning.mjWARN_CONTACTFULL)
_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_CCD_TOLERANCE = 1e-12  # MuJoCo's default of 1e-6 makes gaps of convex geoms noisier than the gap tolerance
_CCD_ITERATIONS = 100
_PARALLEL = 0.99  # cosine of an angle within which MuJoCo takes two faces for parallel


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts between pairs of geoms, ordered by geom ids, so that a chain's contacts stand in the chain's order.

    Attributes:
        labels: ``"first/second"`` per contact: the names of the two geoms, or of their bodies where geoms have none.
        geoms: geom ids, the lower one first, int (h, 2).
        gap: signed distance, less the `SKIN` where there is one, m, (h,).
        position: midway between the two surfaces, world frame, m, (h, 3).
        normal: unit vector from the first geom to the second, world frame, (h, 3).
    """

    labels: tuple[str, ...]
    geoms: np.ndarray
    gap: np.ndarray
    position: np.ndarray
    normal: np.ndarray

    def __len__(self) -> int:
        return len(self.gap)

    def select(self, which: np.ndarray) -> Contacts:
        """Return the contacts of a boolean mask or an index array."""
        index = np.flatnonzero(which) if which.dtype == bool else which
        return Contacts(
            tuple(self.labels[i] for i in index),
            self.geoms[index],
            self.gap[index],
            self.position[index],
            self.normal[index],
        )


@dataclass(frozen=True, eq=False)
class Touch:
    """Contacts with all that an impulse on them needs, at one configuration.

    Attributes:
        contacts: the contacts.
        jacobian: gap gradients ``J``, (h, nv).
        mass_matrix: ``M``, (nv, nv).
    """

    contacts: Contacts
    jacobian: np.ndarray
    mass_matrix: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts) -> Touch:
        """Compute gap gradients and mass matrix at the current frames (`update_positions`)."""
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        return cls(contacts, gap_gradients(model, data, contacts), M)

    @cached_property
    def metric(self) -> KineticMetric:
        """The factored mass matrix."""
        return KineticMetric(self.mass_matrix)

    @cached_property
    def gradients(self) -> np.ndarray:
        """``Y``, the gap gradients where the kinetic metric is Euclidean, (h, nv)."""
        return self.metric.whiten_gradients(self.jacobian)


def read_contacts(model: mujoco.MjModel, data: mujoco.MjData, *, within: float = GAP_TOLERANCE) -> Contacts:
    """Return the contacts whose gap is at most ``within`` now; model and data are left as they are.

    Args:
        model: the compiled scene.
        data: its state; only qpos and mocap poses are read, so that stale derived quantities do not matter.
        within: largest gap reported, m. Geoms that overlap are reported whatever it is.

    Raises:
        SceneError: a contact that is not between two geoms (a flex).
    """
    return detect(model, _position_copy(model, data), within)


def read_collision(model: mujoco.MjModel, data: mujoco.MjData) -> Collision:
    """Return the closed contacts of now as a `Collision`; model and data are left as they are.

    Raises:
        SceneError: a contact that is not between two geoms (a flex).
    """
    scratch = _position_copy(model, data)
    contacts = detect(model, scratch, GAP_TOLERANCE)
    jacobian = gap_gradients(model, scratch, contacts)
    metric = kinetic_metric(model, scratch)
    return Collision(metric.mass_matrix, jacobian, data.qvel, labels=contacts.labels, metric=metric)


def geom_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the name by which each geom appears in contact labels: its own, its body's, or ``geom<id>``."""
    names = []
    for geom in range(model.ngeom):
        body = model.body(model.geom_bodyid[geom])
        names.append(model.geom(geom).name or (body.name if body.id else "") or f"geom{geom}")
    return tuple(names)


def update_positions(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Bring frames, inertia and all that gap gradients need up to data.qpos."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    mujoco.mj_makeM(model, data)


def detect(model: mujoco.MjModel, data: mujoco.MjData, within: float, names: tuple[str, ...] | None = None) -> Contacts:
    """Run MuJoCo's collision detection at the current frames and return the contacts with a gap of at most ``within``.

    Replaces data.contact. Frames must be current (`update_positions`).

    Raises:
        SceneError: a flex is in contact, or there are more contacts than MuJoCo reports.
    """
    names = geom_names(model) if names is None else names
    with _detection_options(model, within + SKIN) as several:
        found = _collide(model, data, names)
        faced = several_contacts(model, found.geoms) if several else np.zeros(0)
        if faced.any():
            model.opt.disableflags &= ~_SINGLE
            found = _complete(_collide(model, data, names), found.select(faced))
    if len(found) == 0:
        return found
    gap = found.gap - touching_distance(model, found.geoms)
    near = np.flatnonzero(gap <= within)
    return replace(found, gap=gap).select(near)


def active_contacts(model: mujoco.MjModel, data: mujoco.MjData, names: tuple[str, ...]) -> Contacts:
    """Return the contacts that MuJoCo's constraint solver acts on now, as the position stage has found them."""
    return _read(data, np.flatnonzero(data.contact.efc_address >= 0), names)


def closing_speed(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return how fast the contacts that MuJoCo's solver acts on close at most, m/s; negative if all open.

    The velocity stage must be current. With pyramidal cones the mean of a contact's first two rows is the normal.
    """
    contact = data.contact
    rows = contact.efc_address[contact.efc_address >= 0]
    if len(rows) == 0:
        return -np.inf
    velocity = data.efc_vel
    normal = velocity[rows]
    if model.opt.cone == _PYRAMIDAL:
        paired = contact.dim[contact.efc_address >= 0] > 1
        normal[paired] = 0.5 * (normal[paired] + velocity[rows[paired] + 1])
    return float(-normal.min())


def _collide(model: mujoco.MjModel, data: mujoco.MjData, names: tuple[str, ...]) -> Contacts:
    warning = data.warning[_FULL]
    before = warning.number
    mujoco.mj_collision(model, data)
    if warning.number != before:
        raise SceneError(
            f'MuJoCo has no room for more than {data.ncon} contacts; give the scene a larger <size memory="..."/>'
        )
    return _read(data, np.arange(data.ncon), names)


def _complete(several: Contacts, nearest: Contacts) -> Contacts:
    """Give contacts between faces the direction of the shortest distance, and add the nearest contact if it is missing.

    Where MuJoCo looks for several contacts, it takes faces within some degrees for parallel and the normal of one of
    them for that of the contacts; and the contacts it chooses need not include the nearest.
    """
    gap, normal = several.gap.copy(), several.normal.copy()
    kept = np.ones(len(nearest), dtype=bool)
    for i, pair in enumerate(nearest.geoms):
        same = np.flatnonzero((several.geoms == pair).all(axis=1))
        cosine = normal[same] @ nearest.normal[i]
        parallel = same[cosine > _PARALLEL]
        gap[parallel] /= cosine[cosine > _PARALLEL]
        normal[parallel] = nearest.normal[i]
        kept[i] = gap[same].min(initial=np.inf) > nearest.gap[i] + GAP_TOLERANCE
    several, missing = replace(several, gap=gap, normal=normal), nearest.select(kept)
    if len(missing) == 0:
        return several
    fields = ("geoms", "gap", "position", "normal")
    parts = [np.concatenate([getattr(several, name), getattr(missing, name)]) for name in fields]
    both = Contacts(several.labels + missing.labels, *parts)
    return both.select(np.lexsort((both.geoms[:, 1], both.geoms[:, 0])))


def _read(data: mujoco.MjData, index: np.ndarray, names: tuple[str, ...]) -> Contacts:
    if len(index) == 0:
        return Contacts((), np.zeros((0, 2), int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    found = data.contact
    geoms = np.array(found.geom[index], dtype=int)
    if (geoms < 0).any():
        raise SceneError("a flex is in contact; an impact law is for contacts between geoms only")
    order = np.lexsort((geoms.max(axis=1), geoms.min(axis=1)))
    geoms, index = geoms[order], index[order]
    normal = np.array(found.frame[index, :3])
    swapped = geoms[:, 0] > geoms[:, 1]
    geoms[swapped] = geoms[swapped, ::-1]
    normal[swapped] *= -1.0
    labels = tuple(f"{names[a]}/{names[b]}" for a, b in geoms)
    return Contacts(labels, geoms, found.dist[index], found.pos[index], normal)


def gap_gradients(model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts) -> np.ndarray:
    """Return ``J``, shape (h, nv): the velocity of the second body's point minus the first's, along the normal."""
    J = np.zeros((len(contacts), model.nv))
    point = np.zeros((3, model.nv))
    weld = model.body_weldid
    for row, geoms, position, normal in zip(J, contacts.geoms, contacts.position, contacts.normal, strict=True):
        for sign, geom in ((-1.0, geoms[0]), (1.0, geoms[1])):
            body = model.geom_bodyid[geom]
            if weld[body] != 0:
                mujoco.mj_jac(model, data, point, None, position, body)
                row += sign * (normal @ point)
    return J


def kinetic_metric(model: mujoco.MjModel, data: mujoco.MjData) -> KineticMetric:
    """Return the factored mass matrix at the current frames (`update_positions`)."""
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return KineticMetric(M)


def _position_copy(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    scratch = mujoco.MjData(model)
    scratch.qpos[:] = data.qpos
    if model.nmocap:
        scratch.mocap_pos[:] = data.mocap_pos
        scratch.mocap_quat[:] = data.mocap_quat
    update_positions(model, scratch)
    return scratch


@contextmanager
def _detection_options(model: mujoco.MjModel, within: float) -> Iterator[bool]:
    """Report the nearest contact of every pair closer than ``within``, whatever margins the scene has.

    The scene's options come back afterwards. Yields whether the scene wants several contacts where faces meet.
    """
    opt = model.opt
    kept = opt.enableflags, opt.disableflags, opt.o_margin, opt.ccd_tolerance, opt.ccd_iterations
    opt.enableflags = (opt.enableflags | _OVERRIDE) & ~_SLEEP
    opt.disableflags = (opt.disableflags | _SINGLE) & ~_NO_CONTACT
    opt.o_margin = 2.0 * within  # MuJoCo compares with "<"; detect() selects
    opt.ccd_tolerance = min(opt.ccd_tolerance, _CCD_TOLERANCE)
    opt.ccd_iterations = max(opt.ccd_iterations, _CCD_ITERATIONS)
    try:
        yield not kept[1] & _SINGLE
    finally:
        opt.enableflags, opt.disableflags, opt.o_margin, opt.ccd_tolerance, opt.ccd_iterations = kept
