"""The entry of MuJoCo's thread into compiled code: a C function, and addresses of its inputs."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import clear, norm, plain, zeros
from impactlaw.stepping.compiled.fields import MODEL, flags, float_at, floats, long_at, longs
from impactlaw.stepping.compiled.libmujoco import is_watched
from impactlaw.stepping.soft.compiled.collide import COUNT, SHORT, SUMS
from impactlaw.stepping.soft.compiled.step import advance
from impactlaw.stepping.soft.compiled.world import CALLBACK, FINE, Law
from impactlaw.stepping.soft.tolerances import FALLS, REST_SPEED

TOTAL = 3
"""Index at which the sums over all steps begin, in the array of `Context.numbers`."""


class Context(NamedTuple):
    """Indices of the numbers that the entry is given: addresses, numbers of entries, and flags."""

    data: int = 0  # address of the data of the world
    # whether the last step has a status other than `FINE`, or any of the steps has had a collision, or has left one to
    # MuJoCo's contacts, written
    news: int = 1
    model: int = 2  # address of the model
    trial: int = 3  # address of other data
    table: int = 4  # address of offsets of fields
    # address of restitution, tangential restitution, rest speed (NaN if not given), and sums over all steps, written
    numbers: int = 5
    exact: int = 6  # whether friction is exact Coulomb friction
    frictional: int = 7  # whether contacts have friction
    most: int = 8  # largest number of collisions, see `world.Law`
    collides: int = 9  # whether the scene can have collisions
    keys: int = 10  # address of the keys of contacts whose restitution is known
    known: int = 11  # number of these keys
    values: int = 12  # address of their restitution
    callbacks: int = 13  # address of the addresses of MuJoCo's callbacks
    callback_count: int = 14  # number of callbacks
    steps: int = 15  # number of steps to take
    states: int = 16  # address of space for the state at the start of each step, followed by its sums, see `collide`
    state_size: int = 17  # number of entries of a state
    status: int = 18  # status of the last step, see `world`, written
    taken: int = 19  # number of finished steps, written
    asked: int = 20  # key of a contact whose restitution is not known, written
    outcomes: int = 21  # address of space for outcomes, see `world.Law`
    outcome_count: int = 22  # number of entries there
    bilateral: int = 23  # address of kinds of equality constraints, see `world.Law`
    constraints: int = 24  # number of equality constraints; 0 if collisions keep the velocity of none of them
    last_exact: int = 25  # whether friction is exact Coulomb friction in the last collision, see `world.Law`


CONTEXT = Context()


@plain
def _rest_speed(model, table, given):
    """Return the closing speed above which contacts collide, see `collisions.Collisions`; it is not given if NaN."""
    if given == given:
        return given
    gravity = floats(model + long_at(table + 8 * MODEL.opt_gravity), 3)
    return max(REST_SPEED, FALLS * float_at(model + long_at(table + 8 * MODEL.opt_timestep)) * norm(gravity))


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
    speed = _rest_speed(c[CONTEXT.model], c[CONTEXT.table], numbers[2])
    law = Law(
        numbers[0], numbers[1], c[CONTEXT.exact] != 0, c[CONTEXT.last_exact] != 0, c[CONTEXT.frictional] != 0,
        speed, c[CONTEXT.most], longs(c[CONTEXT.keys], c[CONTEXT.known]),
        floats(c[CONTEXT.values], c[CONTEXT.known]), c[CONTEXT.asked : CONTEXT.asked + 1],
        floats(c[CONTEXT.outcomes], c[CONTEXT.outcome_count]), flags(c[CONTEXT.bilateral], c[CONTEXT.constraints]),
        zeros(1),
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
        for i in range(SUMS):
            numbers[TOTAL + i] += sums[i]
        c[CONTEXT.taken] += 1
    c[CONTEXT.news] = numbers[TOTAL + COUNT] + numbers[TOTAL + SHORT] > 0.0


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def entry(model, data, simulation, context):
    """Take steps of the world described at an address; the batch's own world is not touched."""
    steps(context)
