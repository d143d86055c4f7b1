"""Friction of MuJoCo's contacts: directions of sliding, torsion and rolling, and their coefficients."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import mujoco
import numpy as np

from impactlaw.scene.contacts import Contacts, acted_on, constraint_rows, sorted_geoms
from impactlaw.scene.moving_surfaces import TORSION, Surfaces
from impactlaw.scene.tolerances import MIN_FRICTION, NO_FRICTION, ORTHOGONAL

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_OVERRIDE = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)


class Span(NamedTuple):
    """The range of the friction rows of one contact."""

    first: int  # the first row; sliding rows come first
    turning: int  # the first row of torsion or rolling
    last: int  # one past the last row
    contact: int  # index of the contact
    bodies: tuple[int, ...]  # bodies of its geoms, -1 for a body that is fixed to the world


class FrictionPattern(NamedTuple):
    """The rows of friction of a sequence of contacts, as far as they do not depend on the configuration."""

    contact: np.ndarray  # index of the contact of each row, ascending, int (k,)
    kind: np.ndarray  # 0 and 1 for sliding, 2 for torsion, 3 and 4 for rolling, int (k,)
    coefficient: np.ndarray  # of each row, dimensionless for sliding, in m for the others, (k,)
    axis: np.ndarray  # axis of each row: 0 for the normal, 1 and 2 for the tangents, int (k,)
    spans: tuple[Span, ...]  # rows by contact
    # all rows, normal rows, (h,), and rows of friction, (k,), sorted by contact: contact of each row, int (h + k,)
    rows_contact: np.ndarray
    rows_kind: np.ndarray  # 0 for a normal row, 1 to 5 for friction, int (h + k,)
    rows_from: np.ndarray  # source of each row, ``[normal rows, rows of friction][rows_from]``, int (h + k,)


def pair_friction(
    model: mujoco.MjModel, geoms: np.ndarray, *, overridden: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return the condim, (h,), and the coefficients, (h, 5), of contacts between pairs of geoms, (h, 2).

    MuJoCo's rule: an explicit pair has its own values; else the geom of higher priority decides, else the larger value.

    Args:
        model: the scene.
        geoms: geom ids.
        overridden: whether MuJoCo's contact override, if it is on, replaces the coefficients. It must be False while a
            step borrows the options of the model.
    """
    first, second = geoms.T
    ahead = model.geom_priority[first].astype(int) - model.geom_priority[second]
    one, other = model.geom_condim[first], model.geom_condim[second]
    dim = np.where(ahead > 0, one, np.where(ahead < 0, other, np.maximum(one, other)))
    mu1, mu2 = (model.geom_friction[geom][:, [0, 0, 1, 2, 2]] for geom in (first, second))
    ahead = ahead[:, None]
    mu = np.where(ahead > 0, mu1, np.where(ahead < 0, mu2, np.maximum(mu1, mu2)))
    for i in range(model.npair):
        pair = model.pair_geom1[i], model.pair_geom2[i]
        same = ((first == pair[0]) & (second == pair[1])) | ((first == pair[1]) & (second == pair[0]))
        dim[same], mu[same] = model.pair_dim[i], model.pair_friction[i]
    if overridden and model.opt.enableflags & _OVERRIDE:
        mu[:] = model.opt.o_friction
    return dim, mu


def learn_friction(
    model: mujoco.MjModel, geoms: np.ndarray, limits: int = 0, *, overridden: bool = False
) -> FrictionPattern | None:
    """Return the rows of friction of contacts between geoms, (h, 2), followed by ``limits`` limits.

    Return None if no contact has friction. For ``overridden`` see `pair_friction`.
    """
    dim, mu = pair_friction(model, geoms, overridden=overridden)
    rows = (np.arange(5) < dim[:, None] - 1) & (mu > MIN_FRICTION)
    if not rows.any():
        return None
    contact, kind = np.nonzero(rows)
    slides = kind < TORSION
    bodies = model.geom_bodyid[geoms]
    bodies = np.where(model.body_weldid[bodies] != 0, bodies, -1)
    rubbing, first, count = np.unique(contact, return_index=True, return_counts=True)
    columns = first, first + np.add.reduceat(slides, first), first + count, rubbing, bodies[rubbing]
    rows_of = zip(*(column.tolist() for column in columns), strict=True)
    spans = [Span(begin, turning, last, i, tuple(pair)) for begin, turning, last, i, pair in rows_of]
    axis, normal = np.where(slides, kind + 1, kind - TORSION), np.arange(len(geoms) + limits)
    rows_contact = np.concatenate([normal, contact])
    rows_kind = np.concatenate([np.zeros_like(normal), kind + 1])
    order = np.argsort(rows_contact, kind="stable")
    rows = rows_contact[order], rows_kind[order], order
    return FrictionPattern(contact, kind, mu[contact, kind], axis, tuple(spans), *rows)


def find_tangents(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    contacts: Contacts,
    friction_pattern: FrictionPattern,
    surfaces: Surfaces | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``J_t``, (k, nv), and the part of moving surfaces beside ``J_t v``, (k,), at the current frames.

    Sliding is in m/s, torsion and rolling are in rad/s. The directions are MuJoCo's: the first tangent is the world's
    y-axis, or z-axis if the normal is near to y, projected onto the tangent plane.
    """
    axis = contact_axes(contacts.normal)[friction_pattern.axis, friction_pattern.contact]
    J = np.empty((len(axis), model.nv))
    for first, turning, last, i, bodies in friction_pattern.spans:
        slide, turn = _relative(model, data, contacts.position[i], bodies)
        J[first:turning] = axis[first:turning] @ slide
        if turning < last:
            J[turning:last] = axis[turning:last] @ turn
    drift = np.zeros(len(axis))
    if surfaces is not None:
        drift = surfaces.motion(data, contacts).along(axis, friction_pattern.contact, friction_pattern.kind)
    return J, drift


def _relative(
    model: mujoco.MjModel, data: mujoco.MjData, point: np.ndarray, bodies: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the Jacobians of relative translation and rotation of the second body at a point, (3, nv) each."""
    one, other = np.zeros((2, 2, 3, model.nv))
    for jacobian, body in zip((one, other), bodies, strict=True):
        if body >= 0:
            mujoco.mj_jac(model, data, jacobian[0], jacobian[1], point, body)
    return other[0] - one[0], other[1] - one[1]


class FrictionRows(NamedTuple):
    """Rows of friction of some contacts."""

    jacobian: np.ndarray  # ``J_t``, (k, nv): sliding in m/s, torsion and rolling in rad/s
    contact: np.ndarray  # index of the contact of each row, ascending, int (k,)
    coefficient: np.ndarray  # of each row, (k,)
    drift: np.ndarray  # velocity of moving surfaces, added to ``J_t v``, (k,)


def active_friction(
    model: mujoco.MjModel, data: mujoco.MjData, contacts: Contacts, surfaces: Surfaces | None
) -> FrictionRows | None:
    """Return the rows of friction of `contacts.active_contacts`, or None if there are none.

    They are taken from MuJoCo's constraint rows; with pyramidal cones they are half of the difference of two rows, over
    the coefficient. Where MuJoCo's tangents are not in the tangent plane, rows are made for corrected tangents, and so
    they are for contacts that have been moved to other positions.
    """
    found, index = data.contact, acted_on(model, data)
    _, _, swapped = sorted_geoms(found.geom[index])
    mu = found.friction[index]
    rows = (np.arange(5) < found.dim[index][:, None] - 1) & (mu > NO_FRICTION)
    if not rows.any():
        return None
    contact, kind = np.nonzero(rows)
    mu, address = mu[contact, kind], found.efc_address[index][contact]
    if model.opt.cone == _PYRAMIDAL:
        first = address + 2 * kind
        J = (constraint_rows(model, data, first) - constraint_rows(model, data, first + 1)) / (2.0 * mu[:, None])
    else:
        J = constraint_rows(model, data, address + 1 + kind)
    frame, drift = found.frame[index], np.zeros(len(contact))
    skew, moved = _straighten(frame), np.flatnonzero((contacts.position != found.pos[index]).any(axis=1))
    if surfaces is None and not len(skew) and not len(moved):
        return FrictionRows(J, contact, mu, drift)
    slides = (kind < TORSION)[:, None]
    axis = frame.reshape(-1, 3, 3)[contact, np.where(kind < TORSION, kind + 1, kind - TORSION)]
    for i in np.union1d(skew, moved).tolist():
        own, bodies = contact == i, model.geom_bodyid[found.geom[index[i]]]
        slide, turn = _relative(model, data, contacts.position[i], tuple(bodies))
        J[own] = np.where(slides[own], axis[own] @ slide, axis[own] @ turn)
    if surfaces is not None:
        drift = surfaces.motion(data, contacts).along(axis, contact, kind)
        drift = np.where(swapped[contact], -drift, drift)
    return FrictionRows(J, contact, mu, drift)


def _straighten(frame: np.ndarray) -> np.ndarray:
    """Make contact frames, (h, 9), orthogonal; return the indices of those that were not, int (k,)."""
    skew = np.flatnonzero(np.abs(np.vecdot(frame[:, :3], frame[:, 3:6])) > ORTHOGONAL)
    if len(skew):
        # compiled code, which reading a scene should not load
        from impactlaw.compiled import for_python
        from impactlaw.scene.corrected.rounding import make_orthogonal

        for_python(make_orthogonal)(frame)
    return skew


def friction_on_contacts(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    contacts: Contacts,
    *,
    contact: np.ndarray,
    jacobian: np.ndarray,
    impulse: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the friction impulses on the second bodies of contacts, world frame: N s and N m s, (h, 3) each.

    They are the vectors with the same generalized impulses as the rows, whatever the axes of these. A component along
    which no body can move is left out, since its row has no impulse.

    Args:
        model: the scene.
        data: the state; frames must be those of the rows.
        contacts: the contacts.
        contact: index of the contact of each row, int (k,); rows of sliding come first in a contact.
        jacobian: ``J_t``, (k, nv).
        impulse: of each row, (k,).
    """
    force, torque = np.zeros((2, len(contacts), 3))
    dims, mus = pair_friction(model, contacts.geoms, overridden=True)
    for i in np.unique(contact).tolist():
        rows = np.flatnonzero(contact == i)
        kinds = np.flatnonzero((np.arange(5) < dims[i] - 1) & (mus[i] > MIN_FRICTION))
        if len(kinds) != len(rows):
            kinds = np.flatnonzero((np.arange(5) < dims[i] - 1) & (mus[i] > NO_FRICTION))
        parts = _relative(model, data, contacts.position[i], tuple(model.geom_bodyid[contacts.geoms[i]]))
        slides = kinds < TORSION
        for which, moves, vector in ((rows[slides], parts[0], force), (rows[~slides], parts[1], torque)):
            if len(which):
                vector[i] = np.linalg.lstsq(moves.T, impulse[which] @ jacobian[which], rcond=None)[0]
    return force, torque


def contact_axes(normal: np.ndarray) -> np.ndarray:
    """Return the axes of contacts, normals first, then two tangents, (3, h, 3)."""
    axes = np.empty((3, *normal.shape))
    axes[0] = normal
    for i, (x, y, z) in enumerate(normal.tolist()):
        p, q, r = (-x * z, -y * z, 1.0 - z * z) if abs(y) >= 0.5 else (-x * y, 1.0 - y * y, -z * y)
        length = sqrt(p * p + q * q + r * r)
        p, q, r = p / length, q / length, r / length
        axes[1, i] = p, q, r
        axes[2, i] = y * r - z * q, z * p - x * r, x * q - y * p
    return axes
