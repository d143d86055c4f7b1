"""Orthonormal bases of the equality constraints that keep their velocity in a collision."""

from __future__ import annotations

import numpy as np

from impactlaw.scene.tolerances import GIVEN_WAY, OWN_CONSTRAINT, WRITTEN
from impactlaw.solvers.cones.algebra.loops import dot, kernel, plain, put
from impactlaw.solvers.tolerances import RANK
from impactlaw.stepping.compiled.access import offset
from impactlaw.stepping.compiled.fields import MODEL, float_at
from impactlaw.stepping.compiled.left_out.tied_contacts import leave_out

_CLEAR = 1.65 * OWN_CONSTRAINT
"""Volume spanned by unit rows, over the root of their number, above which no singular value is below `OWN_CONSTRAINT`.

The volume is the product of the singular values; without the smallest one the product is at most sqrt(e) = 1.65.
"""
_ORTHOGONAL = 1e-15  # cosine between two rows up to which it is rounding
_SWEEPS = 30  # sweeps allowed to Jacobi's method, which needs ten at most


@plain
def least_length(w, given):
    """Return the relative length up to which rows are negligible, where constraints have given way by some m or rad."""
    return min(max(GIVEN_WAY * given / float_at(w.model + offset(w, MODEL.stat_meansize)), WRITTEN), OWN_CONSTRAINT)


@plain
def _turn(one, other, cosine, sine):
    for k in range(len(one)):
        a, b = one[k], other[k]
        one[k], other[k] = cosine * a - sine * b, sine * a + cosine * b


@plain
def _orthogonalize(basis, many, nv):
    """Rotate pairs of rows until all are orthogonal: singular vectors, whose lengths are the singular values.

    This is the one-sided Jacobi method of Hestenes (1958).
    """
    for _ in range(_SWEEPS):
        turned = False
        for p in range(many):
            for q in range(p + 1, many):
                i, j = p * nv, q * nv
                a, b = dot(basis, i, basis, i, nv), dot(basis, j, basis, j, nv)
                c = dot(basis, i, basis, j, nv)
                if abs(c) > _ORTHOGONAL * np.sqrt(a * b):
                    turned, half = True, 0.5 * (b - a) / c
                    t = np.copysign(1.0, half) / (abs(half) + np.sqrt(1.0 + half * half))
                    cosine = 1.0 / np.sqrt(1.0 + t * t)
                    _turn(basis[i : i + nv], basis[j : j + nv], cosine, t * cosine)
        if not turned:
            return


@plain
def _keep_long(basis, many, nv, rank):
    """Move rows that are not short relative to the longest to the front, normalized, and return their number."""
    longest, count = 0.0, 0
    for r in range(many):
        longest = max(longest, dot(basis, r * nv, basis, r * nv, nv))
    for r in range(many):
        row = basis[r * nv : r * nv + nv]
        length = np.sqrt(dot(basis, r * nv, basis, r * nv, nv))
        if length > rank * np.sqrt(longest):
            _put_unit(basis[count * nv : count * nv + nv], row, length)
            count += 1
    return count


@plain
def _put_unit(to, row, length):
    for i in range(len(row)):
        to[i] = row[i] / length


@plain
def _singular_vectors(rows, many, nv, rank, basis):
    """Do what `orthonormal` does by singular values, without directions that constraints only have by giving way."""
    count = 0
    for r in range(many):
        length = np.sqrt(dot(rows, r * nv, rows, r * nv, nv))
        if length > 0.0:
            _put_unit(basis[count * nv : count * nv + nv], rows[r * nv : r * nv + nv], length)
            count += 1
    _orthogonalize(basis, count, nv)
    return _keep_long(basis, count, nv, rank)


@kernel
def orthonormal(rows, many, nv, rank, basis):
    """Write an orthonormal basis of whitened gradients of constraints, row by row; return its size.

    Nearly dependent rows are treated as in `equality_constraints.rows_that_count`.

    Args:
        rows: the gradients, (many nv,).
        many: their number.
        nv: number of degrees of freedom.
        rank: see `least_length`.
        basis: written, with space for one row more than there are gradients, ((many + 1) nv,).
    """
    count, volume = 0, 1.0
    for r in range(many):
        at = count * nv
        row = basis[at : at + nv]
        put(row, rows[r * nv : r * nv + nv])
        left = leave_out(basis, count, nv, basis, at)
        if left <= RANK:
            continue
        _put_unit(row, row, np.sqrt(dot(basis, at, basis, at, nv)))
        count, volume = count + 1, volume * left
        if volume < _CLEAR * np.sqrt(many):
            return _singular_vectors(rows, many, nv, rank, basis)
    return count
