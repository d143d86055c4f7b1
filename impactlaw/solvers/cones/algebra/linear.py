"""Dense LU factors with row exchanges, in flat storage; vanishing pivots are replaced by a small number.

Loops run along rows, so that they become vector instructions without reordering sums.
"""

from impactlaw.solvers.cones.algebra.loops import Array, dot, plain, subtract

_LIFT = 1e-14  # smallest pivot, relative to the largest entry


@plain
def lu_factor(H: Array, base: int, n: int, pivot: Array, at: int) -> None:
    """Factor the n x n matrix that begins at H[base]; write the row exchanges to pivot[at:at + n]."""
    big = 0.0
    for i in range(base, base + n * n):
        big = max(big, abs(H[i]))
    least = _LIFT * big if big > 0.0 else 1.0
    for j in range(n):
        row = base + j * n
        p, best = j, abs(H[row + j])
        for i in range(j + 1, n):
            t = abs(H[base + i * n + j])
            if t > best:
                p, best = i, t
        pivot[at + j] = p
        if p != j:
            other = base + p * n
            for k in range(n):
                t = H[row + k]
                H[row + k] = H[other + k]
                H[other + k] = t
        if not best >= least:
            H[row + j] = least
        inverse = 1.0 / H[row + j]
        for i in range(j + 1, n):
            other = base + i * n
            f = H[other + j] * inverse
            if f != 0.0:
                subtract(H, other + j + 1, H, row + j + 1, f, n - j - 1)
            H[other + j] = f


@plain
def lu_solve(H: Array, base: int, n: int, pivot: Array, at: int, v: Array, first: int) -> None:
    """Overwrite v[first:first + n] by the solution."""
    for j in range(n):
        p = pivot[at + j]
        if p != j:
            t = v[first + j]
            v[first + j] = v[first + p]
            v[first + p] = t
    for i in range(1, n):
        v[first + i] -= dot(H, base + i * n, v, first, i)
    for i in range(n - 1, -1, -1):
        row = base + i * n + i
        v[first + i] = (v[first + i] - dot(H, row + 1, v, first + i + 1, n - i - 1)) / H[row]


@plain
def lu_solve_rows(H: Array, base: int, n: int, pivot: Array, at: int, V: Array, first: int, many: int) -> None:
    """Overwrite the n x many matrix that begins at V[first] by the solution for each of its columns."""
    for j in range(n):
        p = pivot[at + j]
        if p != j:
            a, b = first + j * many, first + p * many
            for c in range(many):
                t = V[a + c]
                V[a + c] = V[b + c]
                V[b + c] = t
    for i in range(1, n):
        a = first + i * many
        for k in range(i):
            subtract(V, a, V, first + k * many, H[base + i * n + k], many)
    for i in range(n - 1, -1, -1):
        a = first + i * many
        for k in range(i + 1, n):
            subtract(V, a, V, first + k * many, H[base + i * n + k], many)
        f = 1.0 / H[base + i * n + i]
        for c in range(many):
            V[a + c] *= f
