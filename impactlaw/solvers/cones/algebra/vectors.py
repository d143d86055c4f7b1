"""Vectors of three numbers in compiled code, as tuples."""

from __future__ import annotations

import numpy as np

from impactlaw.solvers.cones.algebra.loops import plain


@plain
def dot(v, w):
    """Return the inner product of two vectors."""
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]


@plain
def plus(v, factor, w):
    """Return ``v + factor w``."""
    return v[0] + factor * w[0], v[1] + factor * w[1], v[2] + factor * w[2]


@plain
def minus(v, w):
    """Return ``v - w``."""
    return v[0] - w[0], v[1] - w[1], v[2] - w[2]


@plain
def times(factor, v):
    """Return ``factor v``."""
    return factor * v[0], factor * v[1], factor * v[2]


@plain
def cross(v, w):
    """Return the vector product of two vectors."""
    return v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]


@plain
def across(v, axis):
    """Return the part of a vector that is perpendicular to an axis of length 1."""
    return plus(v, -dot(v, axis), axis)


@plain
def length(v):
    """Return the length of a vector."""
    return np.sqrt(dot(v, v))


@plain
def unit(v):
    """Return a vector of the same direction with length 1."""
    size = length(v)
    return v[0] / size, v[1] / size, v[2] / size


@plain
def row(values, i):
    """Return the first three numbers of a row of an array."""
    return values[i, 0], values[i, 1], values[i, 2]


@plain
def axis_of(turn, geom, i):
    """Return an axis of a geom, from the rotation matrices of geoms, (ngeom, 9)."""
    return turn[geom, i], turn[geom, 3 + i], turn[geom, 6 + i]


@plain
def write(v, to):
    """Write a vector to three numbers of an array."""
    to[0], to[1], to[2] = v
