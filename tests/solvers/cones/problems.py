"""Problems for tests of the compiled cone solver, with CSR rows made from dense ones."""

import numpy as np

BILATERAL, BOX, CONE = 0, 1, 2


def problem(Y, sizes, kinds, b, *, tree=None, bound=None, compliance=None):
    """Return the arguments of `solve` that describe a problem."""
    Y = np.asarray(Y, float)
    n, nv = Y.shape
    there = Y != 0
    rownnz = there.sum(axis=1).astype(np.int32)
    rowadr = (np.cumsum(rownnz) - rownnz).astype(np.int32)
    colind = np.nonzero(there)[1].astype(np.int32)
    sizes = np.asarray(sizes, np.int32)
    g = len(sizes)
    return (
        rownnz,
        rowadr,
        colind,
        np.ascontiguousarray(Y[there]),
        nv,
        np.zeros(nv, np.int32) if tree is None else np.asarray(tree, np.int32),
        (np.cumsum(sizes) - sizes).astype(np.int32),
        sizes,
        np.full(g, kinds, np.int32) if np.isscalar(kinds) else np.asarray(kinds, np.int32),
        np.zeros(g) if bound is None else np.asarray(bound, float),
        np.zeros(n) if compliance is None else np.asarray(compliance, float),
        np.asarray(b, float),
    )


def solvable(rng, contacts, nv, m=3, *, exact=True, extra=0, trees=1, spread=0.0):
    """Return a problem made from a solution: contacts that open, slide and stick, and bilateral and box rows."""
    sizes = [m] * contacts + [1] * extra
    kinds = [CONE] * contacts + [BILATERAL if k % 2 else BOX for k in range(extra)]
    n = sum(sizes)
    tree = np.arange(nv) * trees // nv
    Y, x, u, bound = np.zeros((n, nv)), np.zeros(n), np.zeros(n), np.zeros(len(sizes))
    o = 0
    for g, (size, kind) in enumerate(zip(sizes, kinds, strict=True)):
        touched = np.isin(tree, (g % trees, rng.integers(trees)))
        Y[o : o + size, touched] = rng.normal(size=(size, touched.sum())) * 10.0 ** rng.uniform(-spread, spread)
        if kind == CONE:
            t = rng.normal(size=size - 1)
            t /= max(np.linalg.norm(t), 1e-300)
            case = rng.integers(3) if size > 1 else rng.integers(2)
            if case == 0:  # open
                u[o : o + size] = np.append(1.0 + rng.uniform(), 0.5 * t)
            elif case == 1:  # stick
                x[o : o + size] = np.append(1.0, 0.7 * t)
            else:  # slide
                speed = rng.uniform(0.1, 1.0)
                x[o : o + size] = np.append(1.0, -t)
                u[o : o + size] = np.append(0.0 if exact else speed, speed * t)
            unit = np.linalg.norm(Y[o : o + size], axis=1).max()
            u[o : o + size] *= unit
            x[o : o + size] /= unit
        elif kind == BOX:
            bound[g] = 0.5
            x[o] = 0.5 * rng.integers(-1, 2)
            u[o] = -rng.uniform() * np.sign(x[o])
        else:
            x[o] = rng.normal()
        o += size
    compliance = np.repeat(np.array([0.0 if k == CONE else 1e-3 for k in kinds]), sizes)
    b = u - Y @ (Y.T @ x) - compliance * x
    return problem(Y, sizes, kinds, b, tree=tree, bound=bound, compliance=compliance), x


def dense(args):
    """Return Y of the arguments, (n, nv)."""
    rownnz, rowadr, colind, value, nv = args[:5]
    Y = np.zeros((len(rownnz), nv))
    for i, (k, a) in enumerate(zip(rownnz, rowadr, strict=True)):
        Y[i, colind[a : a + k]] = value[a : a + k]
    return Y
