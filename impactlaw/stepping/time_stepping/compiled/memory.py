"""What a world remembers from step to step in compiled code: the impulses of the last step, and some numbers."""

from __future__ import annotations

from typing import NamedTuple

import llvmlite.binding as llvm
import numpy as np
from numba import types

from impactlaw.solvers.cones.loops import kernel, plain
from impactlaw.stepping.time_stepping.compiled.fields import floats, longs, table_ints


class Memory(NamedTuple):
    """Places in the row of numbers of a world; what is left and gained follows.

    Attributes:
        block: address of the impulses of the last step, an int64.
        capacity: bytes there, an int64.
        groups: of the last step, an int64.
        rows: of the last step, an int64.
        known: whether there was a last step, and the state that it left is the one of now if it looks the same, int64.
        solved: whether the last step with contact has met its law, an int64.
        steps: taken so far.
        short_steps: of these, steps that have missed it.
        impacts: steps so far with a collision.
        collided: 1 if the last step had one.
        shortfall: largest amount by which a contact velocity of the last step misses its law, m/s or rad/s.
        worst: the largest of these so far.
        created: energy that the law would have created in the last step, J.
        asked: key of a contact whose restitution is not known, an int64.
        left: nothing but the number of places: here qpos and qvel begin that the last step has left, and after them
            the velocity that forces have led to without contact in the last step.
    """

    block: int = 0
    capacity: int = 1
    groups: int = 2
    rows: int = 3
    known: int = 4
    solved: int = 5
    steps: int = 6
    short_steps: int = 7
    impacts: int = 8
    collided: int = 9
    shortfall: int = 10
    worst: int = 11
    created: int = 12
    asked: int = 13
    left: int = 14


MEMORY = Memory()


def _external(name: str, *arguments: object) -> object:
    return types.ExternalFunction(name, types.int64(*arguments))


assert llvm.address_of_symbol("realloc")
_realloc = _external("realloc", types.int64, types.int64)


@kernel
def last_step(counts):
    """Return groups, keys, coefficients and impulses of the last step; see `contact_problem.recall`."""
    g, n, block = counts[MEMORY.groups], counts[MEMORY.rows], counts[MEMORY.block]
    keys = block
    scale = keys + 8 * g
    impulses = scale + 8 * n
    return table_ints(impulses + 8 * n, 4, g), longs(keys, g), floats(scale, n), floats(impulses, n)


@plain
def forget(counts):
    """Forget the impulses of the last step."""
    counts[MEMORY.groups] = counts[MEMORY.rows] = 0


@kernel
def remember(counts, groups, key, scale, impulses):
    """Keep groups, keys, coefficients and impulses of a step."""
    g, n = len(key), len(scale)
    needed = 8 * g + 16 * n + 16 * g
    if counts[MEMORY.capacity] < needed:
        counts[MEMORY.block] = _realloc(counts[MEMORY.block], 2 * needed)
        counts[MEMORY.capacity] = 2 * needed
    counts[MEMORY.groups], counts[MEMORY.rows] = g, n
    to_groups, to_key, to_scale, to_impulses = last_step(counts)
    to_groups[:] = groups
    to_key[:] = key
    to_scale[:] = scale
    to_impulses[:] = impulses


def make_memory(numbers: int, worlds: int) -> np.ndarray:
    """Return the memory of some worlds that have nothing to remember, (worlds, n)."""
    memory = np.zeros((worlds, len(MEMORY) - 1 + numbers))
    memory.view(np.int64)[:, MEMORY.solved] = 1
    return memory
