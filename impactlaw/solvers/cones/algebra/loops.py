"""The innermost loops, over pieces of flat arrays, which compile to vector instructions.

Indices are unsigned, since support for Python's negative indices would prevent vectorization. Sums may be reassociated
and products contracted, which changes only their rounding. Infinities and NaN are handled as usual.
"""

from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.imputils import impl_ret_new_ref
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from impactlaw.parts import PartCompiler

Array = np.ndarray[Any, Any]
FLOATS: Any = types.Array(types.float64, 1, "C")
INTEGERS: Any = types.Array(types.int64, 1, "C")
UNSIGNED: Any = types.Array(types.uint64, 1, "C")
"""Types of arrays in compiled code."""
_INNER: Any = {"error_model": "numpy", "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def _inner(**options: Any) -> Any:
    """Return a decorator for functions that only compiled functions call.

    Numba would compile such a function again for each literal argument; here literals are treated like other numbers.
    """

    def decorate(function: Any) -> Any:
        made = njit(**_INNER, **options, pipeline_class=PartCompiler)(function)
        template = made.get_call_template

        def any_number(args: Any, kws: Any) -> Any:
            return template(
                tuple(types.unliteral(kind) for kind in args), {name: types.unliteral(kws[name]) for name in kws}
            )

        made.get_call_template = any_number
        return made

    return decorate


kernel: Any = _inner(_nrt=True)
"""Compile a function that only compiled functions call; it is cached on disk with them, see `impactlaw.compiled`."""
plain: Any = _inner(_nrt=False)
"""The same for a function that creates no arrays; it does not count references to its arguments."""
once: Any = njit(**_INNER, inline="always")
"""The same for a small function that is called from one place: it is inlined there, which halves compile time."""
sums: Any = _inner(_nrt=False, fastmath={"reassoc", "contract"})
"""The same for sums that may be reassociated."""
FIRST, ONE = cast(Any, np.int64(0)), cast(Any, np.int64(1))
"""The first index, and the distance of neighbors."""


_SMALL = 2048  # numbers, 16 kB: size up to which arrays are on the stack


def _made(context: Any, builder: Any, kind: Any, many: Any) -> tuple[Any, Any, Any]:
    """Build an array of a number of entries; return it, the address of its data and their size in bytes."""
    item = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind)))
    size = builder.mul(many, item)
    place = cgutils.alloca_once(builder, cgutils.voidptr_t)
    owner = cgutils.alloca_once(builder, cgutils.voidptr_t)
    small = builder.icmp_signed("<=", many, context.get_constant(types.intp, _SMALL))
    with builder.if_else(small) as (then, otherwise):
        with then:
            builder.store(builder.alloca(ir.IntType(8), size), place)
            builder.store(cgutils.get_null_value(cgutils.voidptr_t), owner)
        with otherwise:
            held = context.nrt.meminfo_alloc(builder, size)
            builder.store(context.nrt.meminfo_data(builder, held), place)
            builder.store(held, owner)
    made, address = context.make_array(types.Array(kind, 1, "C"))(context, builder), builder.load(place)
    data = builder.bitcast(address, context.get_data_type(kind).as_pointer())
    populate_array(made, data=data, shape=[many], strides=[item], itemsize=item, meminfo=builder.load(owner))
    return made, address, size


def _room(kind: Any, byte: int | None = None) -> Any:
    """Return a compiled function that makes an array, (n,), with the lifetime of the function that calls it.

    Small arrays are on the stack, which takes no time, and have no reference count: they must not be returned.

    Args:
        kind: type of its numbers.
        byte: initial value of each byte; None for uninitialized memory.
    """
    array = types.Array(kind, 1, "C")

    @intrinsic
    def make(typingctx: Any, many: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            made, address, size = _made(context, builder, kind, values[0])
            if byte is not None:
                cgutils.memset(builder, address, size, byte)
            return impl_ret_new_ref(context, builder, signature.return_type, made._getvalue())

        return array(types.intp), generate

    return make


numbers, indices = _room(types.float64), _room(types.int64)
integers, marks = _room(types.int32), _room(types.boolean)
unsigned = _room(types.uint64)
zeros, cleared, counts = _room(types.float64, 0), _room(types.boolean, 0), _room(types.int64, 0)
unset = _room(types.int64, 255)
"""Integers that are -1."""


_intrinsic: Any = intrinsic


@_intrinsic
def copied(typingctx: Any, source: Any) -> Any:
    """Return a copy of a contiguous array of floats; for its lifetime see `_room`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        given = context.make_array(FLOATS)(context, builder, values[0])
        made, address, size = _made(context, builder, types.float64, cgutils.unpack_tuple(builder, given.shape)[0])
        cgutils.raw_memcpy(builder, address, builder.bitcast(given.data, cgutils.voidptr_t), size, 1)
        return impl_ret_new_ref(context, builder, signature.return_type, made._getvalue())

    return (FLOATS(FLOATS), generate) if source == FLOATS else None


@sums
def subtract(v: Array, to: int, w: Array, source: int, f: float, many: int) -> None:
    """Subtract ``f w[source:source + many]`` from ``v[to:to + many]``."""
    t, s = np.uint64(to), np.uint64(source)
    for k in range(np.uint64(many)):
        v[t + k] -= f * w[s + k]


@sums
def _add_square(
    v: Array, to: int, pitch: int, f: Array, first: int, across: int, down: int, rows: int, w: Array, source: int,
    stride: int,
) -> None:  # fmt: skip
    """Do the work of `add_products` for three columns and three products, with 3 x 3 numbers of w in registers."""
    t, a, s, high, step = np.uint64(to), np.uint64(first), np.uint64(source), np.uint64(pitch), np.uint64(across)
    deep, one, two = np.uint64(down), np.uint64(1), np.uint64(2)
    p0, p1, p2, s = w[s], w[s + one], w[s + two], s + np.uint64(stride)
    q0, q1, q2, s = w[s], w[s + one], w[s + two], s + np.uint64(stride)
    r0, r1, r2 = w[s], w[s + one], w[s + two]
    for _ in range(rows):
        x, y, z = f[a], f[a + deep], f[a + deep + deep]
        v[t] += x * p0 + y * q0 + z * r0
        v[t + one] += x * p1 + y * q1 + z * r1
        v[t + two] += x * p2 + y * q2 + z * r2
        t, a = t + high, a + step


@sums
def add_products(
    v: Array, to: int, pitch: int, f: Array, first: int, across: int, down: int, rows: int, w: Array, source: int,
    stride: int, columns: int, many: int,
) -> None:  # fmt: skip
    """Add the product of a matrix f, rows x many, and a matrix w, many x columns, to a matrix v.

    Entry (i, k) of f is ``f[first + i across + k down]``, (k, j) of w is ``w[source + k stride + j]``, and (i, j) of v
    is ``v[to + i pitch + j]``.
    """
    wide, k = columns - columns % 3, 0
    while k + 3 <= many:
        a, s = first + k * down, source + k * stride
        for j in range(0, wide, 3):
            _add_square(v, to + j, pitch, f, a, across, down, rows, w, s + j, stride)
        if wide < columns:
            for i in range(rows):
                t, b = to + i * pitch + wide, a + i * across
                for n in range(3):
                    subtract(v, t, w, s + n * stride + wide, -f[b + n * down], columns - wide)
        k += 3
    while k < many:
        for i in range(rows):
            subtract(v, to + i * pitch, w, source + k * stride, -f[first + i * across + k * down], columns)
        k += 1


@sums
def dot(v: Array, at: int, w: Array, source: int, many: int) -> float:
    """Return the dot product of ``v[at:at + many]`` and ``w[source:source + many]``."""
    t, s, r = np.uint64(at), np.uint64(source), 0.0
    for k in range(np.uint64(many)):
        r += v[t + k] * w[s + k]
    return r


@sums
def gather_dot(v: Array, at: int, z: Array, cols: Array, begin: int, many: int) -> float:
    """Return the dot product of ``v[at:at + many]`` and the entries ``cols[begin:begin + many]`` of z."""
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


@sums
def gather_three(v: Array, at: int, z: Array, cols: Array, begin: int, many: int, w: Array, to: int) -> None:
    """Write three such products, of adjacent pieces of v, to ``w[to:to + 3]``."""
    p, s, t, one = np.uint64(at), np.uint64(begin), np.uint64(to), np.uint64(1)
    q, r, a, b, c = p + np.uint64(many), p + np.uint64(2 * many), 0.0, 0.0, 0.0
    for k in range(np.uint64(many)):
        f = z[cols[s + k]]
        a, b, c = a + v[p + k] * f, b + v[q + k] * f, c + v[r + k] * f
    w[t], w[t + one], w[t + one + one] = a, b, c


@sums
def scatter_three(v: Array, at: int, x: Array, first: int, z: Array, cols: Array, begin: int, many: int) -> None:
    """Add three adjacent pieces of v times ``x[first:first + 3]`` to these entries of z."""
    p, s, i, one = np.uint64(at), np.uint64(begin), np.uint64(first), np.uint64(1)
    q, r, a, b, c = p + np.uint64(many), p + np.uint64(2 * many), x[i], x[i + one], x[i + one + one]
    for k in range(np.uint64(many)):
        z[cols[s + k]] += a * v[p + k] + b * v[q + k] + c * v[r + k]


@sums
def norm(v: Array) -> float:
    """Return the Euclidean length of v."""
    s = 0.0
    for i in range(len(v)):
        s += v[i] * v[i]
    return np.sqrt(s)


@plain
def any_of(marks: Array) -> bool:
    """Return whether any mark is True."""
    for mark in marks:
        if mark:
            return True
    return False


@plain
def equal(v: Array, w: Array) -> bool:
    """Return whether two arrays of equal length hold the same numbers."""
    for i in range(len(v)):
        if v[i] != w[i]:
            return False
    return True


@plain
def put(to: Array, source: Array) -> None:
    """Copy the numbers of an array into another one."""
    for i in range(len(source)):
        to[i] = source[i]


@plain
def clear(v: Array) -> None:
    """Set the numbers of an array to 0."""
    for i in range(len(v)):
        v[i] = 0.0


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
