"""Calls from a compiled step into Python: to set controls, to ask a law that has no table, and to keep collisions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import extending, types
from numba.core import cgutils

from impactlaw.solvers.cones.algebra.loops import indices, kernel, plain
from impactlaw.stepping.compiled.fields import address_of, keep, longs


class Hook(NamedTuple):
    """Indices of the numbers at `World.python`."""

    function: int = 0  # address of a Python object that is called with the address of a `Call`, and returns a reply
    middle: int = 1  # address of the position in the middle of the step, (nq,), written
    controls: int = 2  # whether there is a control callback to call
    keeps: int = 3  # whether collisions are kept
    damped: int = 4  # whether the integrator damps implicitly, written
    watches: int = 5  # whether problems are passed on


class Call(NamedTuple):
    """Indices of the numbers of a call: its purpose, sizes, and addresses of arrays; share and energy are float64."""

    purpose: int = 0
    groups: int = 1  # number of groups
    rows: int = 2  # number of their rows
    sparse: int = 3  # see `rows.Rows`, like the next six
    colind: int = 4
    value: int = 5
    kinds: int = 6
    key: int = 7
    amounts: int = 8
    rates: int = 9
    target: int = 10  # see `room.Answer`, like the next six; those of a law are written
    sliding: int = 11
    collides: int = 12
    x: int = 13
    change: int = 14
    reached: int = 15
    bound: int = 16
    before: int = 17  # velocity before the collision, (nv,)
    velocity: int = 18  # velocity to which it adds its `change`, (nv,)
    share: int = 19  # share of restitution that is kept
    rounds: int = 20  # rounds of the slower solvers
    created: int = 21  # energy that the law would create without scaling, J


HOOK, CALL = Hook(), Call()
CONTROL, BEGIN, ASK, KEEP, WATCH = 0, 1, 2, 3, 4
"""Purposes: set controls; forget the collisions kept so far in the step; ask the law; keep a collision; pass on
a problem that is about to be solved, with x as the guess.
"""
ERROR, TOGETHER, LOST = -1, 1, 2
"""Replies: an error was raised, after which nothing more may be called, and the step must end; or a sum of whether the
law couples contacts that do not influence each other, and whether it has found no impulses.
"""
_intrinsic: Any = extending.intrinsic


@_intrinsic
def _call(typingctx: Any, function: Any, argument: Any) -> Any:
    """Call a Python object at an address, and return its result, a number, or `ERROR`.

    Python raises the error where this compiled code returns to it. A function of ctypes would lose errors that arise
    outside of it, such as an interrupt at its entry, and its result would then look like a reply.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        python = context.get_python_api(builder)
        state, given = python.gil_ensure(), python.long_from_longlong(values[1])
        result = python.call_function_objargs(builder.inttoptr(values[0], python.pyobj), [given])
        reply = cgutils.alloca_once_value(builder, context.get_constant(types.int64, ERROR))
        with builder.if_then(cgutils.is_not_null(builder, result)):
            builder.store(python.long_as_longlong(result), reply)
        for each in (result, given):
            python.decref(each)
        python.gil_release(state)
        return builder.load(reply)

    return types.int64(types.int64, types.int64), generate


@plain
def hooked(w, what):
    """Return one of the numbers of `Hook`, 0 if this step calls nothing in Python."""
    return longs(w.python, len(HOOK))[what] if w.python != 0 else 0


@kernel
def notify(w, purpose):
    """Call Python without any contacts; return the reply."""
    call = indices(len(CALL))
    call[CALL.purpose] = purpose
    reply = _call(hooked(w, HOOK.function), address_of(call))
    keep(call)
    return reply


@kernel
def tell(w, purpose, rows, answer, before, velocity, share, created, rounds):
    """Call Python with the contacts of a phase; return the reply. For the arguments see `Call`."""
    call = indices(len(CALL))
    call[CALL.purpose], call[CALL.groups], call[CALL.rows] = purpose, len(rows.key), len(answer.x)
    call[CALL.sparse], call[CALL.colind] = address_of(rows.sparse), address_of(rows.colind)
    call[CALL.value], call[CALL.kinds] = address_of(rows.value), address_of(rows.groups)
    call[CALL.key], call[CALL.amounts] = address_of(rows.key), address_of(rows.amounts)
    call[CALL.rates], call[CALL.target] = address_of(rows.rates), address_of(answer.target)
    call[CALL.sliding], call[CALL.collides] = address_of(answer.sliding), address_of(answer.collides)
    call[CALL.x], call[CALL.change] = address_of(answer.x), address_of(answer.change)
    call[CALL.reached], call[CALL.bound] = address_of(answer.reached), address_of(answer.bound)
    call[CALL.before], call[CALL.velocity] = address_of(before), address_of(velocity)
    call.view(np.float64)[CALL.share], call.view(np.float64)[CALL.created] = share, created
    call[CALL.rounds] = rounds
    reply = _call(hooked(w, HOOK.function), address_of(call))
    keep(call)
    return reply
