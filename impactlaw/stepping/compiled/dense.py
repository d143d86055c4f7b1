"""Convert between MuJoCo's layouts and others: sparse rows, and forces of pyramidal cones."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np

from impactlaw.solvers.cones.algebra.loops import plain

_ROWS = 64
_ROUNDING = 1e-12  # force up to which a contact does not push, relative to the largest of the step


@lru_cache(maxsize=8)
def _columns(nv: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    nnz = np.full(rows, nv, dtype=np.int32)
    return nnz, np.arange(rows, dtype=np.int32) * nv, np.tile(np.arange(nv, dtype=np.int32), rows)


def sparse_jacobian(
    model: mujoco.MjModel, data: mujoco.MjData
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return number of entries and first entry of MuJoCo's rows, columns, and entries; dense rows include zeros."""
    if mujoco.mj_isSparse(model):
        return data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind, data.efc_J
    nv, n = model.nv, data.nefc
    rows = _ROWS
    while rows < n:
        rows *= 2
    nnz, adr, col = _columns(nv, rows)
    return nnz[:n], adr[:n], col[: n * nv], data.efc_J.reshape(-1)


@plain
def leave_open_out(force, gap, touch, dim, address, contacts, owners):
    """Move open contacts that do not push behind the others; return how many the others are.

    Contacts are looked for farther away than MuJoCo lists them: readers of the list and sensors take each for a touch.
    Rounding of the solvers is no push.

    Args:
        force: forces of rows with elliptic cones, (n,).
        gap: gaps of contacts, m, (ncon,), like the next two part of ``contacts``.
        touch: gap, m, up to which a contact is closed.
        dim: number of rows of each contact, (ncon,).
        address: first row of each contact, (ncon,).
        contacts: MuJoCo's contacts, whole, (ncon, ..), reordered.
        owners: contact of each row, or what other rows belong to, (n,), written for rows of contacts.
    """
    count, least = 0, 0.0
    for each in force:
        least = max(least, _ROUNDING * abs(each))
    for i in range(len(dim)):
        if gap[i] > touch and not (address[i] >= 0 and abs(force[address[i]]) > least):
            continue
        if count < i:
            for k in range(contacts.shape[1]):
                contacts[i, k], contacts[count, k] = contacts[count, k], contacts[i, k]
        count += 1
    if count < len(dim):
        for i in range(len(dim)):
            if address[i] >= 0:
                owners[address[i] : address[i] + dim[i]] = i
    return count


@plain
def encode_pyramids(force, elliptic, address, dim, friction, out):
    """Convert forces of rows with elliptic cones to those with pyramidal cones, half of ``f_n / m ± f_k / mu_k`` each.

    Args:
        force: forces of the rows with elliptic cones, (n,).
        elliptic: first row of each contact with elliptic cones, (ncon,).
        address: first row of each contact with pyramidal cones, (ncon,).
        dim: condim of each contact, (ncon,).
        friction: coefficients, (ncon, 5).
        out: forces with pyramidal cones, written.
    """
    first = len(out)
    for i in range(len(dim)):
        if address[i] >= 0:
            first = min(first, address[i])
    out[:] = 0.0
    for r in range(min(first, len(force))):
        out[r] = force[r]
    for i in range(len(dim)):
        if address[i] < 0 or elliptic[i] < 0:
            continue
        if dim[i] == 1:
            out[address[i]] = force[elliptic[i]]
        for k in range(1, dim[i]):
            normal, along = force[elliptic[i]] / (dim[i] - 1), force[elliptic[i] + k] / friction[i, k - 1]
            out[address[i] + 2 * (k - 1)] = 0.5 * (normal + along)
            out[address[i] + 2 * (k - 1) + 1] = 0.5 * (normal - along)
