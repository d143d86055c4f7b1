"""The entry of MuJoCo's batches into compiled code: a C function of a simulation, and addresses of its inputs."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
import numpy as np
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import copied, indices, numbers, put
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.fields import SIZE, address_of, floats, keep, long_at, longs
from impactlaw.stepping.compiled.pooled import copy_out, other_data
from impactlaw.stepping.integration import STEP_STATE
from impactlaw.stepping.time_stepping.compiled.state.memory import go_back, impulses_of
from impactlaw.stepping.time_stepping.compiled.state.status import CALLBACK, FINE, RAISED, UNKNOWN
from impactlaw.stepping.time_stepping.compiled.state.world import SETTING
from impactlaw.stepping.time_stepping.compiled.step import advance


class Context(NamedTuple):
    """Indices of the numbers that an entry is given: addresses, some followed by the number of entries there."""

    data: int = 0  # data of the world
    status: int = 1  # how the step has ended, written
    model: int = 2  # the scene's model
    scratch: int = 3  # other data
    table: int = 4  # offsets of fields
    settings: int = 5  # see `world.Settings`
    carriers: int = 6  # which mocap body carries each geom
    bilateral: int = 7  # kinds of equality constraints, 0 for those that a collision may violate
    keys: int = 8  # keys of the law's contacts, and their number
    values: int = 9  # restitution of these contacts
    known: int = 10
    memory: int = 11  # memory of the world, and its size
    memories: int = 12
    structure: int = 13  # room for a copy of the model's structure, or the model itself, see `copy_model`
    margins: int = 14  # room for the margins of the copy, and their number
    margin_count: int = 15
    state: int = 16  # room for the state, and its size
    states: int = 17
    before: int = 18  # room for a copy of the memory before the step
    callbacks: int = 19  # addresses of MuJoCo's callbacks, and their number
    callback_count: int = 20
    asked: int = 21  # see `law.LawTable`, written
    python: int = 22  # see `world.World`


CONTEXT = Context()


@linked("void(int64)")
def one_step(context):
    """Take one step of one world."""
    c = longs(context, len(CONTEXT))
    own = c[CONTEXT.structure] == c[CONTEXT.model]  # MuJoCo passes callbacks no copy of the model
    if not own and mj.is_watched(longs(c[CONTEXT.callbacks], c[CONTEXT.callback_count])):
        c[CONTEXT.status] = CALLBACK
        return
    memory, before = floats(c[CONTEXT.memory], c[CONTEXT.memories]), floats(c[CONTEXT.before], c[CONTEXT.memories])
    put(before, memory)
    c[CONTEXT.status] = advance(
        c[CONTEXT.model], c[CONTEXT.data], c[CONTEXT.scratch], c[CONTEXT.table], c[CONTEXT.settings],
        c[CONTEXT.carriers], c[CONTEXT.bilateral], longs(c[CONTEXT.keys], c[CONTEXT.known]),
        floats(c[CONTEXT.values], c[CONTEXT.known]), c[CONTEXT.asked : CONTEXT.asked + 1], memory,
        c[CONTEXT.structure], floats(c[CONTEXT.margins], c[CONTEXT.margin_count]),
        floats(c[CONTEXT.state], c[CONTEXT.states]), False, c[CONTEXT.python],
    )  # fmt: skip
    if c[CONTEXT.status] == UNKNOWN or c[CONTEXT.status] == RAISED:
        # the impulses of the last step have not been overwritten
        go_back(memory, before, impulses_of(before.view(np.int64)))


class Worlds(NamedTuple):
    """Indices of the numbers that an entry for many worlds is given; names in _of are arrays with one row per world."""

    table: int = 0  # offsets of fields
    carriers: int = 1  # which mocap body carries each geom
    bilateral: int = 2  # kinds of equality constraints, 0 for those that a collision may violate
    margin_count: int = 3  # number of margins of a copy of a model
    states: int = 4  # size of a state
    memories: int = 5  # size of the memory of a world
    steps: int = 6  # number of steps to take
    slots: int = 7  # pairs of data and other data, one for each thread of the pool, and their number
    slot_count: int = 8
    settings_of: int = 9  # see `world.Settings`
    laws_of: int = 10  # address of keys, address of values, and their number, int64 (nsim, 3)
    memory_of: int = 11  # see `memory`
    status_of: int = 12  # how the last call has ended, and the key that was unknown, int64 (nsim, 2), written
    # fields of data to copy out: offset of their address in data, address of the output of world 0, and size in bytes
    # for each world, int64 (k, 3)
    outputs: int = 13
    output_count: int = 14  # k
    forces: int = 15  # whether the forces on bodies in the last timestep are computed, such as cfrc_ext


WORLDS = Worlds()


@linked("void(int64,int64,int64,int64)")
def some_steps(model, data, world, context):
    """Take the steps of one of many worlds; after a failure its state and memory are restored.

    Therefore a world whose law does not know a contact yet takes the same steps, once it knows it, as if it had always
    known it.
    """
    c = longs(context, len(WORLDS))
    n, many = c[WORLDS.memories], c[WORLDS.states]
    memory = floats(c[WORLDS.memory_of] + 8 * n * world, n)
    report = longs(c[WORLDS.status_of] + 16 * world, 2)
    where = longs(c[WORLDS.laws_of] + 24 * world, 3)
    keys, values = longs(where[0], where[2]), floats(where[1], where[2])
    settings = c[WORLDS.settings_of] + 8 * len(SETTING) * world
    structure = indices(long_at(c[WORLDS.table] + 8 * SIZE.model) // 8)
    margins, state, first = numbers(c[WORLDS.margin_count]), numbers(many), numbers(many)
    other = other_data(model, data, longs(c[WORLDS.slots], 2 * c[WORLDS.slot_count]))
    before, impulses = copied(memory), copied(impulses_of(memory.view(np.int64)))
    mj.get_state(model, data, address_of(first), STEP_STATE)
    for step in range(c[WORLDS.steps]):
        report[0] = advance(
            model, data, other, c[WORLDS.table], settings, c[WORLDS.carriers], c[WORLDS.bilateral], keys, values,
            report[1:2], memory, address_of(structure), margins, state, step == 0, 0,
        )  # fmt: skip
        if report[0] != FINE:
            mj.set_state(model, data, address_of(first), STEP_STATE)
            go_back(memory, before, impulses)
            break
    if report[0] == FINE:  # otherwise data is that of the step that failed, or of another world
        if c[WORLDS.forces] != 0:
            mj.rne_post_constraint(address_of(structure), data)  # the copy has the cones of the step
        copy_out(data, world, c[WORLDS.outputs], c[WORLDS.output_count])
    keep(structure)
    keep(first)


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def many(model, data, world, context):
    """Take the steps of one of many worlds."""
    some_steps(model, data, world, context)


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def single(model, data, simulation, context):
    """Take one step of the world described at an address; the batch's own world is not touched."""
    one_step(context)
