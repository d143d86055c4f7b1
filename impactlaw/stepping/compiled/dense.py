"""MuJoCo's Jacobian as sparse rows."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np

_ROWS = 64


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
