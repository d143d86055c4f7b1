"""Where MuJoCo's thread enters compiled code: a C function, and numbers that say where all else is."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear
from impactlaw.stepping.compiled.fields import flags, floats, longs
from impactlaw.stepping.compiled.libmujoco import is_watched
from impactlaw.stepping.soft.compiled.collide import SUMS
from impactlaw.stepping.soft.compiled.step import advance
from impactlaw.stepping.soft.compiled.world import CALLBACK, FINE

TOTAL = 3
"""Where the sums over all steps begin among the numbers."""


class Context(NamedTuple):
    """Places in the numbers that the entry is given: addresses, counts, and yes or no.

    Attributes:
        model: of the scene.
        data: of the world.
        trial: other data.
        table: offsets of fields.
        numbers: restitution, tangential restitution, rest speed, and the sums over all steps that are taken, written.
        exact: exact Coulomb friction.
        frictional: contacts have friction.
        most: collisions, see `world.Law`.
        collides: anything can collide.
        keys: of the law's contacts, and how many.
        values: their restitution.
        callbacks: addresses of MuJoCo's callbacks, and how many.
        steps: to take.
        states: room for the state at the start of each step, followed by its sums, see `collide`; and how many numbers
            a state has.
        status: how the last step has ended, written.
        taken: steps that are over, written.
        asked: key of a contact that is not known, written.
        outcomes: room for outcomes, see `world.Law`, and how many numbers.
        bilateral: which equality constraints collisions keep, and how many there are; 0 if they keep none.
        last_exact: exact Coulomb friction in a collision that ends the matter.
    """

    model: int = 0
    data: int = 1
    trial: int = 2
    table: int = 3
    numbers: int = 4
    exact: int = 5
    frictional: int = 6
    most: int = 7
    collides: int = 8
    keys: int = 9
    known: int = 10
    values: int = 11
    callbacks: int = 12
    callback_count: int = 13
    steps: int = 14
    states: int = 15
    state_size: int = 16
    status: int = 17
    taken: int = 18
    asked: int = 19
    outcomes: int = 20
    outcome_count: int = 21
    bilateral: int = 22
    constraints: int = 23
    last_exact: int = 24


CONTEXT = Context()


@linked("void(int64)")
def steps(context):
    """Take steps until one ends in another way than it should."""
    c = longs(context, len(CONTEXT))
    numbers, width = floats(c[CONTEXT.numbers], TOTAL + SUMS), c[CONTEXT.state_size]
    c[CONTEXT.taken] = 0
    clear(numbers[TOTAL:])
    if is_watched(longs(c[CONTEXT.callbacks], c[CONTEXT.callback_count])):
        c[CONTEXT.status] = CALLBACK
        return
    outcomes = floats(c[CONTEXT.outcomes], c[CONTEXT.outcome_count])
    while c[CONTEXT.taken] < c[CONTEXT.steps]:
        i = c[CONTEXT.taken]
        state = c[CONTEXT.states] + 8 * (width + SUMS) * i
        sums = floats(state + 8 * width, SUMS)
        c[CONTEXT.status] = advance(
            c[CONTEXT.model], c[CONTEXT.data], c[CONTEXT.trial], c[CONTEXT.table],
            numbers[0], numbers[1], c[CONTEXT.exact] != 0, c[CONTEXT.last_exact] != 0, c[CONTEXT.frictional] != 0,
            numbers[2], c[CONTEXT.most],
            longs(c[CONTEXT.keys], c[CONTEXT.known]), floats(c[CONTEXT.values], c[CONTEXT.known]),
            c[CONTEXT.asked : CONTEXT.asked + 1], outcomes,
            flags(c[CONTEXT.bilateral], c[CONTEXT.constraints]), floats(state, width), sums,
            c[CONTEXT.collides] != 0,
        )  # fmt: skip
        if c[CONTEXT.status] != FINE:
            return
        numbers[TOTAL:] += sums
        c[CONTEXT.taken] += 1


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def entry(model, data, simulation, context):
    """Take steps of the world that the numbers at an address tell of; the batch's own is not touched."""
    steps(context)
