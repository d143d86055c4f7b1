"""Functions of compiled steps that steps in Python call, too."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic

from impactlaw.linked import linked


class EngineError(Exception):
    """MuJoCo has raised an error in compiled code."""


def shared(*signature: Any, counts: bool = True) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator like `linked` for a function that Python calls, too, by `compiled.for_python`.

    Its first argument is a world with a pool, ``w.pool``, through which it is then called: otherwise errors of MuJoCo
    in compiled code would end the process. Here they raise `EngineError`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        call, code, name = (
            linked(*signature, counts=counts)(function),
            function.__code__,
            f"{function.__name__}_for_python",
        )
        place = {"co_name": name, "co_filename": code.co_filename, "co_firstlineno": code.co_firstlineno}
        inside = FunctionType(_attempt.__code__.replace(**place), {"attempt": _guarded(call)}, name)
        inside.__module__, inside.__qualname__ = function.__module__, name
        call.for_python = inside
        return call

    return decorate


attempt: Any = None  # each function has its own


def _attempt(w, *others):
    return attempt(w, others)


def _guarded(call: Any) -> Any:
    """Return a numba intrinsic that calls a linked function through the pool of its first argument.

    The pool calls a C function, whose argument is the place of the function's arguments and of its result.
    """
    returned, kinds = call.signature.return_type, call.signature.args

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        world, others = values
        arguments = [world, *cgutils.unpack_tuple(builder, others, len(kinds) - 1)]
        given = zip(arguments, (signature.args[0], *signature.args[1]), kinds, strict=True)
        arguments = [context.cast(builder, *argument) for argument in given]
        held = ir.LiteralStructType([context.get_value_type(kind) for kind in (*kinds, returned)])
        place = cgutils.alloca_once(builder, held)
        for i, argument in enumerate(arguments):
            builder.store(argument, cgutils.gep_inbounds(builder, place, 0, i))
        inside = _inside(context, builder.module, held)
        long, number = ir.IntType(64), ir.IntType(32)
        apply = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(number, [long, long, number, long, long, number]), "mjb_apply"
        )
        pool = builder.extract_value(world, kinds[0].fields.index("pool"))
        pointers = builder.ptrtoint(inside, long), builder.ptrtoint(place, long)
        failed = builder.call(apply, [pool, long(0), number(1), *pointers, number(0)])
        with cgutils.if_unlikely(builder, cgutils.is_not_null(builder, failed)):
            context.call_conv.return_user_exc(builder, EngineError)
        return builder.load(cgutils.gep_inbounds(builder, place, 0, len(kinds)))

    def _inside(context: Any, module: Any, held: Any) -> Any:
        """Return the C function."""
        long = ir.IntType(64)
        function = ir.Function(
            module, ir.FunctionType(ir.VoidType(), [long, long, ir.IntType(32), long]), f"{call.symbol}_inside"
        )
        function.linkage = "internal"
        builder = ir.IRBuilder(function.append_basic_block())
        place = builder.inttoptr(function.args[3], held.as_pointer())
        arguments = [builder.load(cgutils.gep_inbounds(builder, place, 0, i)) for i in range(len(kinds))]
        kind = context.call_conv.get_function_type(returned, kinds)
        callee = cgutils.get_or_insert_function(module, kind, call.symbol)
        _, result = context.call_conv.call_function(builder, callee, returned, kinds, arguments)
        builder.store(result, cgutils.gep_inbounds(builder, place, 0, len(kinds)))
        builder.ret_void()
        return function

    @intrinsic
    def attempt(typingctx: Any, world: Any, others: Any) -> Any:
        return returned(world, others), generate

    return attempt
