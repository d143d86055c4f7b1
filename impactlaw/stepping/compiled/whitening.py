"""Velocities and gradients where the kinetic metric is the Euclidean one, by MuJoCo's sparse factor ``M = L^T D L``."""

from __future__ import annotations

from impactlaw.compiled import compiled
from impactlaw.solvers.cones.algebra.loops import plain

_ROUNDING = 1e-12  # of entries of J, m or m/rad: limbs that overlap where their joint is cannot be moved apart


@plain
def whiten(nnz, adr, col, val, start, work, mark, factor, Mnnz, Madr, Mcol, root, tree, treeadr, treenum, out, colout):
    """Write one row of ``Y = J L^-1 D^-1/2`` to the end of what is known of Y and return the number of its entries.

    Entries of J that are rounding are 0: a row of such entries would let huge impulses through.

    Args:
        nnz: entries of the row of J.
        adr: where they begin.
        col: degrees of freedom of all entries of J.
        val: the entries of J.
        start: where the row is to begin in out.
        work: zeros, (nv,); zeros again in the end.
        mark: trees that the row touches, (ntree,); False again in the end.
        factor: L, strictly lower part of rows as in MuJoCo's M.
        Mnnz: entries of each row of M.
        Madr: where they begin.
        Mcol: their columns, the diagonal last.
        root: ``D^-1/2``, (nv,).
        tree: of each degree of freedom.
        treeadr: first degree of freedom of each tree.
        treenum: number of them.
        out: the entries of Y.
        colout: their degrees of freedom.
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
    """Write ``L^-1 D^-1/2 z``, the velocity of whitened coordinates, (nv,)."""
    for i in range(len(z)):
        s = z[i] * root[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            s -= factor[a] * v[Mcol[a]]
        v[i] = s


@plain
def apply_inverse(factor, Mnnz, Madr, Mcol, inverse, x):
    """Overwrite a force, (nv,), by ``M_h^-1 f``."""
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
    """Write ``z = D^1/2 L v``, (nv,), whose products with whitened rows are the velocities of these."""
    for i in range(len(velocity)):
        s = velocity[i]
        for a in range(Madr[i], Madr[i] + Mnnz[i] - 1):
            s += factor[a] * velocity[Mcol[a]]
        z[i] = s / root[i]
