"""Collisions made from contact velocities and the Delassus matrix alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlaw.errors import MeasurementError
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction import Friction
from impactlaw.recording.layout import MOST_COUPLED

_RANK = 1e-9  # eigenvalue of G, relative to the largest one, that is rounding
_REACHED = 1e-6  # relative size of contact velocities outside of the range of G, or of their change, that is ignored
_CONSTANT = 1e-3  # misfit relative to the jumps up to which one G explains all collisions
_WAY_OUT = (
    "choose other collisions by contacts, or write a table that has it in a column delassus, or mass_matrix and "
    f"jacobian (recordings have it of up to {MOST_COUPLED} contacts and rows of friction)"
)


def collision_of(
    G: np.ndarray, before: np.ndarray, after: np.ndarray, labels: tuple[str, ...], contact: np.ndarray, mu: np.ndarray
) -> tuple[Collision, np.ndarray]:
    """Return a collision with M = 1, ``J J^T = G`` and these contact velocities, and its v+.

    The part of contact velocities that no impulse can change becomes the velocity of surfaces. Examples are motion
    across the plane of a planar robot, and motion that equality constraints prescribe.

    Args:
        G: Delassus matrix of the normal rows followed by the friction rows, (h + k, h + k).
        before: ``gamma-``, then ``gamma_t-``, (h + k,).
        after: ``gamma+``, then ``gamma_t+``, (h + k,).
        labels: labels of the contacts, (h,).
        contact: index of the contact of each friction row, (k,).
        mu: coefficients of friction, (k,).

    Raises:
        MeasurementError: G is not symmetric and positive semidefinite, or no motion has this velocity jump.
    """
    h = len(labels)
    if not np.allclose(G, G.T, rtol=0, atol=1e-8 * np.abs(G).max()):
        raise MeasurementError("delassus is not symmetric")
    w, V = np.linalg.eigh(0.5 * (G + G.T))
    if w[-1] <= 0 or w[0] < -1e-8 * w[-1]:
        raise MeasurementError(f"delassus is not positive: eigenvalues {w[0]:.3g} to {w[-1]:.3g}")
    large = w > _RANK * w[-1]
    J, inverse = V[:, large] * np.sqrt(w[large]), (V[:, large] / np.sqrt(w[large])).T
    v, post = inverse @ before, inverse @ after
    rest, rest_after = before - J @ v, after - J @ post
    scale = np.abs(before).max() + np.abs(after).max()
    if np.abs(rest_after - rest).max() > _REACHED * scale:
        raise MeasurementError("no motion of these contacts has this jump of their velocities: G is singular")
    surfaces = 0.5 * (rest + rest_after) if np.abs(rest).max() > _REACHED * scale else np.zeros(len(G))
    order = np.argsort(contact, kind="stable")
    friction = Friction(J[h:][order], contact[order], mu[order], surfaces[h:][order]) if len(contact) else None
    return Collision(np.eye(len(v)), J[:h], v, labels=labels, surface_velocity=surfaces[:h], friction=friction), post


def delassus_by_contacts(
    rows: Sequence[int],
    given: Sequence[np.ndarray | None],
    labels: Sequence[tuple[str, ...]],
    contacts: Sequence[np.ndarray],
    before: Sequence[np.ndarray],
    after: Sequence[np.ndarray],
    impulses: Sequence[np.ndarray | None],
) -> list[np.ndarray]:
    """Return G of each collision: as given, else fitted to ``gamma+ - gamma- = G Lambda`` of those without.

    The fitted one is the same for all collisions with the same contacts. Messages name the rows of the table.

    Raises:
        MeasurementError: impulses are missing, there are too few collisions, or no G explains them.
    """
    known: dict[tuple, np.ndarray] = {}
    keys = [(own, tuple(of_rows)) for own, of_rows in zip(labels, contacts, strict=True)]
    missing = [i for i, G in enumerate(given) if G is None]
    for key in dict.fromkeys(keys[i] for i in missing):
        which = [i for i in missing if keys[i] == key]
        mine = [impulse for i in which if (impulse := impulses[i]) is not None]
        if len(mine) == len(which):
            jumps = np.array([after[i] - before[i] for i in which])
            known[key] = symmetric_least_squares(np.array(mine), jumps, key[0])
        elif len(before[which[0]]) == 1:
            known[key] = np.ones((1, 1))
        else:
            raise MeasurementError(
                f"contacts {', '.join(key[0])} have neither delassus nor impulses, row {rows[which[0]]}"
            )
    return [known[key] if G is None else G for key, G in zip(keys, given, strict=True)]


def symmetric_least_squares(L: np.ndarray, D: np.ndarray, labels: tuple[str, ...]) -> np.ndarray:
    """Return the symmetric G that minimizes ``|L G - D|``, with impulses in the rows of L and jumps in D, (m, n)."""
    n = L.shape[1]
    rows, columns = np.triu_indices(n)
    basis = np.zeros((len(rows), n, n))  # symmetric matrices with one or two entries of 1
    basis[np.arange(len(rows)), rows, columns] = basis[np.arange(len(rows)), columns, rows] = 1.0
    A = np.einsum("mj,pij->mip", L, basis).reshape(-1, len(rows))
    x, _, rank, _ = np.linalg.lstsq(A, D.ravel(), rcond=1e-9)
    if rank < len(rows):
        raise MeasurementError(
            f"{len(L)} collisions of contacts {', '.join(labels)} are too few, or too alike, to tell their Delassus "
            f"matrix; {_WAY_OUT}"
        )
    if np.linalg.norm(A @ x - D.ravel()) > _CONSTANT * np.linalg.norm(D):
        raise MeasurementError(
            f"no Delassus matrix explains all collisions of contacts {', '.join(labels)}: it changes with the "
            f"configuration; {_WAY_OUT}"
        )
    return np.einsum("p,pij->ij", x, basis)
