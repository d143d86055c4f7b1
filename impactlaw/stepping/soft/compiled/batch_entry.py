"""The entry of MuJoCo's batches into compiled soft steps: a C function of a world, and addresses of its inputs."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import mujoco
import numba
from numba import types

from impactlaw.linked import linked
from impactlaw.solvers.cones.algebra.loops import numbers, zeros
from impactlaw.stepping.compiled import libmujoco as mj
from impactlaw.stepping.compiled.fields import address_of, flags, floats, keep, longs
from impactlaw.stepping.compiled.pooled import copy_out, other_data
from impactlaw.stepping.soft.compiled.collide import COUNT, LAST, SCALED, SHORT, SUMS
from impactlaw.stepping.soft.compiled.step import advance
from impactlaw.stepping.soft.compiled.world import FINE, PYTHON, SETTING, UNKNOWN, Law

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


class Worlds(NamedTuple):
    """Indices of the numbers that the entry is given; names in _of are arrays with one row per world."""

    table: int = 0  # address of offsets of fields
    bilateral: int = 1  # address of kinds of equality constraints, see `world.Law`
    constraints: int = 2  # number of equality constraints; 0 if collisions keep the velocity of none of them
    frictional: int = 3  # whether contacts have friction
    collides: int = 4  # whether the scene can have collisions
    steps: int = 5  # number of steps to take
    slots: int = 6  # address of pairs of data, see `pooled.other_data`
    slot_count: int = 7  # number of these pairs
    settings_of: int = 8  # address of `world.Settings`, one row per world
    laws_of: int = 9  # address of keys, address of values, and their number, int64 (nsim, 3)
    states_of: int = 10  # address of space for the state at the start of the call
    states: int = 11  # number of entries of a state
    # numbers of steps so far with a collision, with one whose restitution was scaled, and with one without restitution
    # or with E = 0 after the largest number of collisions, (nsim, 3), written
    memory_of: int = 12
    # status of the call, the key that is not known, and the number of steps taken, int64 (nsim, 3), written; a call
    # that is repeated goes on after these steps
    status_of: int = 13
    outputs: int = 14  # address of descriptions of outputs, see `pooled.copy_out`
    output_count: int = 15  # number of outputs
    forces: int = 16  # whether to compute the forces on bodies in the last timestep, such as cfrc_ext


WORLDS = Worlds()


@linked("void(int64,int64,int64,int64)")
def some_steps(model, data, world, context):
    """Take the steps of one of many worlds; stop where Python has to go on; after a failure restore the state."""
    c = longs(context, len(WORLDS))
    width, report = c[WORLDS.states], longs(c[WORLDS.status_of] + 24 * world, 3)
    first = floats(c[WORLDS.states_of] + 8 * width * world, width)
    where = longs(c[WORLDS.laws_of] + 24 * world, 3)
    settings = floats(c[WORLDS.settings_of] + 8 * len(SETTING) * world, len(SETTING))
    memory = floats(c[WORLDS.memory_of] + 24 * world, 3)
    state, sums = numbers(width), numbers(SUMS)
    law = Law(
        settings[SETTING.restitution], settings[SETTING.sliding], settings[SETTING.exact] != 0.0,
        settings[SETTING.last_exact] != 0.0, c[WORLDS.frictional] != 0, settings[SETTING.rest_speed],
        int(settings[SETTING.most]), longs(where[0], where[2]), floats(where[1], where[2]), report[1:2],
        numbers(0), flags(c[WORLDS.bilateral], c[WORLDS.constraints]), zeros(1),
    )  # fmt: skip
    other = other_data(model, data, longs(c[WORLDS.slots], 2 * c[WORLDS.slot_count]))
    if report[2] == 0:
        mj.get_state(model, data, address_of(first), _STATE)
    while report[2] < c[WORLDS.steps]:
        report[0] = advance(model, data, other, c[WORLDS.table], law, state, sums, c[WORLDS.collides] != 0)
        if report[0] != FINE:
            break
        report[2] += 1
        memory[0] += sums[COUNT] > 0.0
        memory[1] += sums[SCALED] > 0.0
        memory[2] += sums[LAST] + sums[SHORT] > 0.0
    if report[0] == FINE:  # otherwise data is that of the failed step, or of another world
        if c[WORLDS.forces] != 0:
            mj.rne_post_constraint(model, data)
        copy_out(data, world, c[WORLDS.outputs], c[WORLDS.output_count])
    elif report[0] != PYTHON and report[0] != UNKNOWN:
        mj.set_state(model, data, address_of(first), _STATE)
    keep(first)


@cast(Any, numba).cfunc(types.void(types.int64, types.int64, types.int32, types.int64))
def many(model, data, world, context):
    """Take the steps of one of many worlds."""
    some_steps(model, data, world, context)
