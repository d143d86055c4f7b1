"""Coordinates in which the kinetic metric is Euclidean, by MuJoCo's sparse factor ``M = L^T D L``."""

from __future__ import annotations

from impactlaw.compiled import compiled
from impactlaw.solvers.cones.algebra.loops import plain

_ROUNDING = 1e-12  # smallest entries of J, m or m/rad: limbs that overlap at their common joint cannot be moved apart


@plain
def whiten(nnz, adr, col, val, start, work, mark, factor, Mnnz, Madr, Mcol, root, tree, treeadr, treenum, out, colout):
    """Append one row of ``Y = J L^-1 D^-1/2`` to the known rows of Y, and return the number of its entries.

    Entries of J that are rounding are set to 0: a row of such entries would admit huge impulses.

    Args:
        nnz: number of entries of the row of J.
        adr: index of the first entry.
        col: degree of freedom of all entries of J.
        val: the entries of J.
        start: index in ``out`` at which the row begins.
        work: zeros, (nv,); zeros again at the end.
        mark: trees that the row touches, (ntree,); False again at the end.
        factor: L, strictly lower part of rows as in MuJoCo's M.
        Mnnz: number of entries of each row of M.
        Madr: index of the first entry of each row.
        Mcol: column of each entry, the diagonal last.
        root: ``D^-1/2``, (nv,).
        tree: tree of each degree of freedom.
        treeadr: first degree of freedom of each tree.
        treenum: number of degrees of freedom of each tree.
        out: the entries of Y.
        colout: degree of freedom of each entry of Y.
    """
    for k in range(adr, adr + nnz):
        if abs(val[k]) > _ROUNDING:
            work[col[k]] = val[k]
            mark[tree[col[k]]] = True
    count = start
    for k in range(adr, adr + nnz):
        t = tree[col[k]]
        if not mark[t]:
            continue
        mark[t] = False
        for i in range(treeadr[t] + treenum[t] - 1, treeadr[t] - 1, -1):
            x = work[i]
            if x != 0.0:
                for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
                    work[Mcol[a]] -= factor[a] * x
                out[count] = x * root[i]
                colout[count] = i
                count += 1
                work[i] = 0.0
    return count - start


@plain
def unwhitened(z, factor, Mnnz, Madr, Mcol, root, v):
    """Write ``L^-1 D^-1/2 z``, the velocity for whitened coordinates z, (nv,)."""
    for i in range(len(z)):
        s = z[i] * root[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            s -= factor[a] * v[Mcol[a]]
        v[i] = s


@plain
def apply_inverse(factor, Mnnz, Madr, Mcol, inverse, x):
    """Replace a force, (nv,), by ``M_h^-1 f``."""
    for i in range(len(x) - 1, -1, -1):
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            x[Mcol[a]] -= factor[a] * x[i]
    for i in range(len(x)):
        x[i] *= inverse[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            x[i] -= factor[a] * x[Mcol[a]]


@compiled()
def solve_inertia(force, factor, Mnnz, Madr, Mcol, inverse):
    """Return ``M_h^-1 f``, (nv,)."""
    x = force.copy()
    apply_inverse(factor, Mnnz, Madr, Mcol, inverse, x)
    return x


@plain
def whitened(velocity, factor, Mnnz, Madr, Mcol, root, z):
    """Write ``z = D^1/2 L v``, (nv,), whose products with whitened rows are the velocities of the rows."""
    for i in range(len(velocity)):
        s = velocity[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            s += factor[a] * velocity[Mcol[a]]
        z[i] = s / root[i]
