"""The innermost loops, over pieces of flat arrays, as vector instructions.

Indices are unsigned, because Python's negative ones keep a compiler from vectorizing. Sums may be reassociated, and
products contracted, which changes them by rounding only; nothing is assumed about infinities and NaN.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.imputils import impl_ret_new_ref
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

Array = np.ndarray[Any, Any]
_INNER: Any = {"error_model": "numpy", "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
kernel: Any = njit(**_INNER | {"_nrt": True})
"""Compile a function that only compiled functions call.

`solve` is stored on disk with all that it calls, and numba looks at the text of solve.py alone to see whether that
is still valid: delete `__pycache__/*.nb*` after a change of other files.
"""
plain: Any = njit(**_INNER | {"_nrt": False})
"""The same for a function that makes no arrays: it does not count who holds those that it is given."""
once: Any = njit(**_INNER, inline="always")
"""The same for a function that is called from one place: it becomes a part of its caller, which halves compile time."""
sums: Any = njit(**_INNER | {"_nrt": False, "fastmath": {"reassoc", "contract"}})
"""The same for sums that may be reassociated."""
FIRST: Any = np.int64(0)
"""The first index; numba would compile functions once more for a literal 0."""


_SMALL = 2048  # numbers, 16 kB


def _room(kind: Any) -> Any:
    """Return a compiled function that makes an array, (n,), that lives as long as the function that asks for it.

    Small ones are on the stack, which takes no time, and nobody counts who holds them: they must not be returned.
    """
    array = types.Array(kind, 1, "C")

    @intrinsic
    def make(typingctx: Any, many: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            item = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind)))
            size = builder.mul(values[0], item)
            place = cgutils.alloca_once(builder, cgutils.voidptr_t)
            owner = cgutils.alloca_once(builder, cgutils.voidptr_t)
            small = builder.icmp_signed("<=", values[0], context.get_constant(types.intp, _SMALL))
            with builder.if_else(small) as (then, otherwise):
                with then:
                    builder.store(builder.alloca(ir.IntType(8), size), place)
                    builder.store(cgutils.get_null_value(cgutils.voidptr_t), owner)
                with otherwise:
                    held = context.nrt.meminfo_alloc(builder, size)
                    builder.store(context.nrt.meminfo_data(builder, held), place)
                    builder.store(held, owner)
            made = context.make_array(array)(context, builder)
            data = builder.bitcast(builder.load(place), context.get_data_type(kind).as_pointer())
            populate_array(
                made, data=data, shape=[values[0]], strides=[item], itemsize=item, meminfo=builder.load(owner)
            )
            return impl_ret_new_ref(context, builder, signature.return_type, made._getvalue())

        return array(types.intp), generate

    return make


numbers, indices = _room(types.float64), _room(types.int64)
integers, marks = _room(types.int32), _room(types.boolean)
unsigned = _room(types.uint64)


@once
def zeros(n: int) -> Array:
    """Return n zeros; see `_room`."""
    made = numbers(n)
    for i in range(n):
        made[i] = 0.0
    return made


@once
def filled(n: int, value: int) -> Array:
    """Return n integers of one value; see `_room`."""
    made = indices(n)
    for i in range(n):
        made[i] = value
    return made


@once
def cleared(n: int) -> Array:
    """Return n marks that are False; see `_room`."""
    made = marks(n)
    for i in range(n):
        made[i] = False
    return made


@once
def copied(source: Array) -> Array:
    """Return a copy of some numbers; see `_room`."""
    made = numbers(len(source))
    for i in range(len(source)):
        made[i] = source[i]
    return made


@sums
def subtract(v: Array, to: int, w: Array, source: int, f: float, many: int) -> None:
    """Subtract ``f w[source:source + many]`` from ``v[to:to + many]``."""
    t, s = np.uint64(to), np.uint64(source)
    for k in range(np.uint64(many)):
        v[t + k] -= f * w[s + k]


@sums
def dot(v: Array, at: int, w: Array, source: int, many: int) -> float:
    """Return the product of ``v[at:at + many]`` and ``w[source:source + many]``."""
    t, s, r = np.uint64(at), np.uint64(source), 0.0
    for k in range(np.uint64(many)):
        r += v[t + k] * w[s + k]
    return r


@sums
def gather_dot(v: Array, at: int, z: Array, cols: Array, begin: int, many: int) -> float:
    """Return the product of ``v[at:at + many]`` and the entries ``cols[begin:begin + many]`` of z."""
    t, s, r = np.uint64(at), np.uint64(begin), 0.0
    for k in range(np.uint64(many)):
        r += v[t + k] * z[cols[s + k]]
    return r


@sums
def scatter_add(v: Array, at: int, f: float, z: Array, cols: Array, begin: int, many: int) -> None:
    """Add ``f v[at:at + many]`` to the entries ``cols[begin:begin + many]`` of z."""
    t, s = np.uint64(at), np.uint64(begin)
    for k in range(np.uint64(many)):
        z[cols[s + k]] += f * v[t + k]


@plain
def norm(v: Array) -> float:
    """Return the Euclidean length of v."""
    s = 0.0
    for i in range(len(v)):
        s += v[i] * v[i]
    return np.sqrt(s)


@plain
def fill(v: Array, at: int, many: int, value: float) -> None:
    """Write a number into ``v[at:at + many]``."""
    t = np.uint64(at)
    for k in range(np.uint64(many)):
        v[t + k] = value


@plain
def add_at(v: Array, base: int, w: Array, cols: Array, begin: int, many: int) -> None:
    """Add ``w[:many]`` to the entries ``base + cols[begin:begin + many]`` of v."""
    t, s = np.uint64(base), np.uint64(begin)
    for k in range(np.uint64(many)):
        v[t + cols[s + k]] += w[k]
