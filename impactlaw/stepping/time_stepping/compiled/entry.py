"""Where MuJoCo's batches enter compiled code: a C function of a simulation, and numbers that say where all else is."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
from numba import types

from impactlaw.compiled import compiled
from impactlaw.linked import linked
from impactlaw.solvers.cones.loops import plain
from impactlaw.stepping.time_stepping.compiled.fields import floats, long_at, longs, put
from impactlaw.stepping.time_stepping.compiled.law import LawTable
from impactlaw.stepping.time_stepping.compiled.status import CALLBACK
from impactlaw.stepping.time_stepping.compiled.step import advance


class Context(NamedTuple):
    """Places in the numbers that an entry is given: addresses, and after some of them how many numbers are there.

    Attributes:
        model: of the scene.
        data: of the world.
        scratch: other data.
        table: offsets of fields.
        settings: see `world.Settings`.
        sizes: of bodies.
        bilateral: which equality constraints a collision must not violate.
        keys: of the law's contacts, and how many.
        values: their restitution.
        memory: of the world, and how many numbers.
        structure: room for a copy of the model's structure.
        margins: room for its margins, and how many.
        state: room for the state, and how many numbers.
        before: room for the memory as it was before the step.
        callbacks: addresses of MuJoCo's callbacks, and how many.
        status: how the step has ended, written.
        asked: see `law.LawTable`, written.
    """

    model: int = 0
    data: int = 1
    scratch: int = 2
    table: int = 3
    settings: int = 4
    sizes: int = 5
    bilateral: int = 6
    keys: int = 7
    values: int = 8
    known: int = 9
    memory: int = 10
    memories: int = 11
    structure: int = 12
    margins: int = 13
    margin_count: int = 14
    state: int = 15
    states: int = 16
    before: int = 17
    callbacks: int = 18
    callback_count: int = 19
    status: int = 20
    asked: int = 21


CONTEXT = Context()


@plain
def _is_watched(callbacks):
    """Return whether a callback of MuJoCo is set, which may be in Python."""
    for i in range(len(callbacks)):
        if long_at(callbacks[i]) != 0:
            return True
    return False


@compiled("void(int64)")
def one_step(context):
    """Take one step of one world."""
    c = longs(context, len(CONTEXT))
    if _is_watched(longs(c[CONTEXT.callbacks], c[CONTEXT.callback_count])):
        c[CONTEXT.status] = CALLBACK
        return
    memory = floats(c[CONTEXT.memory], c[CONTEXT.memories])
    put(floats(c[CONTEXT.before], c[CONTEXT.memories]), memory)
    law = LawTable(
        longs(c[CONTEXT.keys], c[CONTEXT.known]),
        floats(c[CONTEXT.values], c[CONTEXT.known]),
        c[CONTEXT.asked : CONTEXT.asked + 1],
    )
    c[CONTEXT.status] = advance(
        c[CONTEXT.model],
        c[CONTEXT.data],
        c[CONTEXT.scratch],
        c[CONTEXT.table],
        c[CONTEXT.settings],
        c[CONTEXT.sizes],
        c[CONTEXT.bilateral],
        law,
        memory,
        c[CONTEXT.structure],
        floats(c[CONTEXT.margins], c[CONTEXT.margin_count]),
        floats(c[CONTEXT.state], c[CONTEXT.states]),
        False,
    )


_one_step = linked(one_step)


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def single(model, data, simulation, context):
    """Take one step of the world that the numbers at an address tell of; the batch's own is not touched."""
    _one_step(context)
