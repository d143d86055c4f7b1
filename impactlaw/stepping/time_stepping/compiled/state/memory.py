"""The memory of a world from step to step in compiled code: the impulses of the last step, and some numbers."""

from __future__ import annotations

import ctypes
import struct
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import types

from impactlaw.solvers.cones.algebra.loops import equal, kernel, plain, put
from impactlaw.stepping.compiled.access import data_floats, size
from impactlaw.stepping.compiled.fields import DATA, MODEL, floats
from impactlaw.stepping.time_stepping.compiled.state.room import keep_known, known_at
from impactlaw.stepping.time_stepping.compiled.state.surfaces import forget_surfaces, surface_room


class Memory(NamedTuple):
    """Indices of the numbers of a world; the arrays described at ``left`` follow."""

    block: int = 0  # address of the impulses of the last step, an int64
    capacity: int = 1  # size in bytes, an int64
    groups: int = 2  # number of groups of the last step, an int64
    rows: int = 3  # number of rows of the last step, an int64
    other: int = 4  # address of a second block, with the impulses of the step before the last one
    other_capacity: int = 5  # its size in bytes, an int64
    # whether there was a last step whose final state is the current one if it looks the same, int64
    known: int = 6
    solved: int = 7  # whether the last step with contact has met the law, an int64
    steps: int = 8  # number of steps so far
    short_steps: int = 9  # number of steps that have not met the law, see `scheme.TimeStepping`
    impacts: int = 10  # number of steps with a collision
    inadmissible: int = 11  # number of steps with a collision whose outcome by the law left S(v-)
    collided: int = 12  # 1 if the last step had a collision
    shortfall: int = 13  # largest amount by which a contact velocity of the last step misses the law, m/s or rad/s
    worst: int = 14  # largest such amount so far
    created: int = 15  # energy that the law would have created in the last step, J
    work: int = 16  # remaining part of the work allowed in this step, see `solvers.cones.budget`
    found_groups: int = 17  # number of groups of the impulses found so far in a step that is taken again, an int64
    found_rows: int = 18  # number of their rows, 0 if there are none, an int64
    found_work: int = 19  # remaining part of the allowed work when they were found
    sums: int = 20  # six sums over the collisions of the last step, see `impulses.sums`, if they are asked for
    # number of these indices. The following arrays begin here: qpos and qvel at the end of the last step, the change of
    # velocity by forces without contact in the last step, the change by contact if nothing collided, frames, see
    # `keep_frames`, and the motion of mocap bodies, see `surfaces`
    left: int = 26


MEMORY = Memory()
FRAME = 12
"""Number of values kept for the frames of each body: one field of each stage that updates frames to the state.

A state can be restored in data without its frames.
"""
_BLOCK = struct.Struct("=4q")  # layout of the first numbers


_LIBC = ctypes.CDLL(None)
_LIBC.realloc.restype = ctypes.c_size_t
_LIBC.realloc.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
_LIBC.free.restype = None
_realloc: Any = types.ExternalFunction("realloc", types.int64(types.int64, types.int64))


@kernel
def last_step(counts):
    """Return what is `Known` of the last step."""
    return known_at(counts[MEMORY.block], counts[MEMORY.groups], counts[MEMORY.rows])


@kernel
def found_so_far(counts):
    """Return the same for the impulses found so far in a step that is taken again, or those of the last step."""
    if counts[MEMORY.found_rows] == 0:
        return last_step(counts)
    return known_at(counts[MEMORY.other], counts[MEMORY.found_groups], counts[MEMORY.found_rows])


@plain
def forget(counts):
    """Forget the impulses of the last step."""
    counts[MEMORY.groups] = counts[MEMORY.rows] = 0


@plain
def remember_so_far(counts, rows, impulses):
    """Store what later problems need to know of the rows of a step that is taken again, and of their impulses."""
    g, n = len(rows.key), len(impulses)
    needed = 24 * g + 32 * n
    if counts[MEMORY.other_capacity] < needed:
        counts[MEMORY.other_capacity] = 2 * needed
        counts[MEMORY.other] = _realloc(counts[MEMORY.other], 2 * needed)
    counts[MEMORY.found_groups], counts[MEMORY.found_rows] = g, n
    keep_known(known_at(counts[MEMORY.other], g, n), rows, impulses)


@plain
def remember(counts, rows, impulses):
    """Store what the next step needs to know of the rows of a step and of their impulses."""
    remember_so_far(counts, rows, impulses)
    for one, other in ((MEMORY.block, MEMORY.other), (MEMORY.capacity, MEMORY.other_capacity)):
        counts[one], counts[other] = counts[other], counts[one]
    counts[MEMORY.groups], counts[MEMORY.rows] = counts[MEMORY.found_groups], counts[MEMORY.found_rows]


@kernel
def impulses_of(counts):
    """Return the numbers in which `last_step` is stored."""
    return floats(counts[MEMORY.block], 3 * counts[MEMORY.groups] + 4 * counts[MEMORY.rows])


@plain
def go_back(memory, before, impulses):
    """Restore the memory before a step, with these `impulses_of`; the blocks of impulses stay where they are."""
    counts, was = memory.view(np.int64), before.view(np.int64)
    counts[MEMORY.groups], counts[MEMORY.rows] = was[MEMORY.groups], was[MEMORY.rows]
    put(memory[MEMORY.known :], before[MEMORY.known :])
    if counts[MEMORY.capacity] < 8 * len(impulses):
        counts[MEMORY.capacity] = 8 * len(impulses)
        counts[MEMORY.block] = _realloc(counts[MEMORY.block], 8 * len(impulses))
    put(impulses_of(counts), impulses)


@plain
def are_left(w, kept):
    """Return whether frames and velocities of bodies are still those at the end of the last step."""
    n = size(w, MODEL.nbody)
    return (
        equal(data_floats(w, DATA.xipos, 3 * n), kept[: 3 * n])
        and equal(data_floats(w, DATA.subtree_com, 3 * n), kept[3 * n : 6 * n])
        and equal(data_floats(w, DATA.cvel, 6 * n), kept[6 * n :])
    )


@plain
def keep_frames(w, kept):
    """Store frames and velocities of bodies at the end of a step."""
    n = size(w, MODEL.nbody)
    put(kept, data_floats(w, DATA.xipos, 3 * n))
    put(kept[3 * n :], data_floats(w, DATA.subtree_com, 3 * n))
    put(kept[6 * n :], data_floats(w, DATA.cvel, 6 * n))


def make_memory(model: mujoco.MjModel, worlds: int) -> np.ndarray:
    """Return the empty memory of some worlds, (worlds, n)."""
    more = model.nq + 3 * model.nv + FRAME * model.nbody + surface_room(model)
    memory = np.zeros((worlds, MEMORY.left + more))
    begin(memory, slice(None), model)
    return memory


def begin(memory: np.ndarray, worlds: Any, model: mujoco.MjModel) -> None:
    """Clear the memory of some worlds, except the blocks of impulses."""
    counts = memory.view(np.int64)
    counts[worlds, MEMORY.known], counts[worlds, MEMORY.solved] = 0, 1
    memory[worlds, MEMORY.steps : MEMORY.left] = 0.0
    forget_surfaces(memory, worlds, model)


def free(memory: np.ndarray) -> None:
    """Free the blocks of impulses."""
    for counts in memory.view(np.int64):
        for place in (MEMORY.block, MEMORY.other):
            _LIBC.free(ctypes.c_void_p(int(counts[place])))
            counts[place] = 0
        counts[[MEMORY.capacity, MEMORY.other_capacity, MEMORY.groups, MEMORY.rows]] = 0


def raw(numbers: np.ndarray) -> bytes:
    """Return a copy of the impulses of a world, given its numbers; the block must not have been overwritten since."""
    block, _, g, n = _BLOCK.unpack_from(numbers.data)
    return ctypes.string_at(block, 24 * g + 32 * n) if g else b""


def restore(numbers: np.ndarray, kept: np.ndarray, impulses: bytes) -> None:
    """Restore the memory of another world in a world with empty memory."""
    counts, mine = numbers.view(np.int64), [MEMORY.block, MEMORY.capacity, MEMORY.other, MEMORY.other_capacity]
    blocks = counts[mine].copy()
    numbers[:] = kept
    counts[mine] = blocks
    if impulses:
        counts[MEMORY.block] = block = _LIBC.realloc(ctypes.c_void_p(int(counts[MEMORY.block])), len(impulses))
        counts[MEMORY.capacity] = len(impulses)
        ctypes.memmove(block, impulses, len(impulses))
