"""The entry of MuJoCo's thread into compiled code: a C function, and addresses of its inputs."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear
from impactlaw.stepping.compiled.fields import flags, floats, longs
from impactlaw.stepping.compiled.libmujoco import is_watched
from impactlaw.stepping.soft.compiled.collide import COUNT, SUMS
from impactlaw.stepping.soft.compiled.step import advance
from impactlaw.stepping.soft.compiled.world import CALLBACK, FINE, Law

TOTAL = 3
"""Index at which the sums over all steps begin, in the array of `Context.numbers`."""


class Context(NamedTuple):
    """Indices of the numbers that the entry is given: addresses, numbers of entries, and flags.

    Attributes:
        data: address of the data of the world.
        news: whether the last step has a status other than `FINE`, or any of the steps has had a collision, written.
        model: address of the model.
        trial: address of other data.
        table: address of offsets of fields.
        numbers: address of restitution, tangential restitution, rest speed, and the sums over all steps, written.
        exact: whether friction is exact Coulomb friction.
        frictional: whether contacts have friction.
        most: largest number of collisions, see `world.Law`.
        collides: whether the scene can have collisions.
        keys: address of the keys of contacts whose restitution is known.
        known: number of these keys.
        values: address of their restitution.
        callbacks: address of the addresses of MuJoCo's callbacks.
        callback_count: number of callbacks.
        steps: number of steps to take.
        states: address of space for the state at the start of each step, followed by its sums, see `collide`.
        state_size: number of entries of a state.
        status: status of the last step, see `world`, written.
        taken: number of finished steps, written.
        asked: key of a contact whose restitution is not known, written.
        outcomes: address of space for outcomes, see `world.Law`.
        outcome_count: number of entries there.
        bilateral: address of kinds of equality constraints, see `world.Law`.
        constraints: number of equality constraints; 0 if collisions keep the velocity of none of them.
        last_exact: whether friction is exact Coulomb friction in the last collision, see `world.Law`.
    """

    data: int = 0
    news: int = 1
    model: int = 2
    trial: int = 3
    table: int = 4
    numbers: int = 5
    exact: int = 6
    frictional: int = 7
    most: int = 8
    collides: int = 9
    keys: int = 10
    known: int = 11
    values: int = 12
    callbacks: int = 13
    callback_count: int = 14
    steps: int = 15
    states: int = 16
    state_size: int = 17
    status: int = 18
    taken: int = 19
    asked: int = 20
    outcomes: int = 21
    outcome_count: int = 22
    bilateral: int = 23
    constraints: int = 24
    last_exact: int = 25


CONTEXT = Context()


@linked("void(int64)")
def steps(context):
    """Take the steps, until one of them has a status other than `FINE`."""
    c = longs(context, len(CONTEXT))
    numbers, width = floats(c[CONTEXT.numbers], TOTAL + SUMS), c[CONTEXT.state_size]
    c[CONTEXT.taken], c[CONTEXT.news] = 0, 1
    clear(numbers[TOTAL:])
    if is_watched(longs(c[CONTEXT.callbacks], c[CONTEXT.callback_count])):
        c[CONTEXT.status] = CALLBACK
        return
    law = Law(
        numbers[0], numbers[1], c[CONTEXT.exact] != 0, c[CONTEXT.last_exact] != 0, c[CONTEXT.frictional] != 0,
        numbers[2], c[CONTEXT.most], longs(c[CONTEXT.keys], c[CONTEXT.known]),
        floats(c[CONTEXT.values], c[CONTEXT.known]), c[CONTEXT.asked : CONTEXT.asked + 1],
        floats(c[CONTEXT.outcomes], c[CONTEXT.outcome_count]), flags(c[CONTEXT.bilateral], c[CONTEXT.constraints]),
    )  # fmt: skip
    while c[CONTEXT.taken] < c[CONTEXT.steps]:
        i = c[CONTEXT.taken]
        state = c[CONTEXT.states] + 8 * (width + SUMS) * i
        sums = floats(state + 8 * width, SUMS)
        c[CONTEXT.status] = advance(
            c[CONTEXT.model], c[CONTEXT.data], c[CONTEXT.trial], c[CONTEXT.table], law, floats(state, width), sums,
            c[CONTEXT.collides] != 0,
        )  # fmt: skip
        if c[CONTEXT.status] != FINE:
            return
        numbers[TOTAL:] += sums
        c[CONTEXT.taken] += 1
    c[CONTEXT.news] = numbers[TOTAL + COUNT] > 0.0


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def entry(model, data, simulation, context):
    """Take steps of the world described at an address; the batch's own world is not touched."""
    steps(context)
