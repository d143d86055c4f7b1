"""Where MuJoCo's batches enter compiled code: a C function of a simulation, and numbers that say where all else is."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
from numba import types

from impactlaw.compiled import compiled
from impactlaw.linked import linked
from impactlaw.stepping.time_stepping.compiled.fields import ALL, flags, floats, longs
from impactlaw.stepping.time_stepping.compiled.law import LawTable
from impactlaw.stepping.time_stepping.compiled.step import advance
from impactlaw.stepping.time_stepping.compiled.world import SETTING


class Context(NamedTuple):
    """Places in the numbers that an entry is given: addresses, and after some of them how many numbers are there.

    Attributes:
        model: of the scene.
        data: of the world.
        scratch: other data.
        table: offsets of fields.
        settings: see `world.Settings`.
        sizes: of bodies, and how many.
        bilateral: equality constraints, and how many.
        keys: of the law's contacts, and how many.
        values: their restitution.
        memory: of the world, and how many numbers.
        structure: room for a copy of the model's structure.
        margins: room for its margins, and how many.
        state: room for the state, and how many numbers.
        status: how the step has ended, written.
        asked: see `law.LawTable`, written.
    """

    model: int = 0
    data: int = 1
    scratch: int = 2
    table: int = 3
    settings: int = 4
    sizes: int = 5
    bodies: int = 6
    bilateral: int = 7
    equalities: int = 8
    keys: int = 9
    values: int = 10
    known: int = 11
    memory: int = 12
    memories: int = 13
    structure: int = 14
    margins: int = 15
    margin_count: int = 16
    state: int = 17
    states: int = 18
    status: int = 19
    asked: int = 20


CONTEXT = Context()


@compiled("void(int64)")
def one_step(context):
    """Take one step of one world."""
    c = longs(context, len(CONTEXT))
    law = LawTable(
        longs(c[CONTEXT.keys], c[CONTEXT.known]),
        floats(c[CONTEXT.values], c[CONTEXT.known]),
        c[CONTEXT.asked : CONTEXT.asked + 1],
    )
    c[CONTEXT.status] = advance(
        c[CONTEXT.model],
        c[CONTEXT.data],
        c[CONTEXT.scratch],
        longs(c[CONTEXT.table], ALL),
        floats(c[CONTEXT.settings], len(SETTING)),
        floats(c[CONTEXT.sizes], c[CONTEXT.bodies]),
        flags(c[CONTEXT.bilateral], c[CONTEXT.equalities]),
        law,
        floats(c[CONTEXT.memory], c[CONTEXT.memories]),
        c[CONTEXT.structure],
        floats(c[CONTEXT.margins], c[CONTEXT.margin_count]),
        floats(c[CONTEXT.state], c[CONTEXT.states]),
        False,
    )


_one_step = linked(one_step)


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def single(model, data, simulation, context):  # noqa: ARG001
    """Take one step of the world that the numbers at an address tell of; the batch's own is not touched."""
    _one_step(context)
