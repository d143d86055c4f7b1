"""Compiled functions that others call by address: numba would make a copy of them in each function that calls them.

Numba puts all that a function calls into its own machine code, and compiles it once more for that. What is linked is
compiled once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba.core import cgutils, types
from numba.extending import intrinsic

from impactlaw.compiled import compiled
from impactlaw.compiling import Declared


def linked(*signature: Any, counts: bool = True) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function of one signature, which only compiled functions can call.

    It needs nothing that takes Python's objects apart, and the cache keeps no code of it for those that call it.

    Args:
        signature: see `compiled`.
        counts: see `compiled`.
    """
    return lambda function: by_address(compiled(*signature, counts=counts, python=False)(function))


def by_address(function: Any) -> Any:
    """Return what compiled functions call instead of a compiled function that has one signature of its own.

    The symbol that stands for it in caches on disk is made here, before anything is loaded that needs it.
    """
    made = function.function if isinstance(function, Declared) else function
    symbol = f"impactlaw_{made.__module__.replace('.', '_')}_{made.__name__}"
    if isinstance(function, Declared):  # only called by what is compiled here for other processes
        signature = function.returned(*function.arguments)
        address = ctypes.cast(ctypes.pythonapi.Py_IncRef, ctypes.c_void_p).value
    else:
        (overload,) = function.overloads.values()
        signature, address = (
            overload.signature,
            overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name),
        )
    llvm.add_symbol(symbol, address)

    def generate(context: Any, builder: Any, called: Any, values: Any) -> Any:
        returned, arguments = signature.return_type, signature.args
        values = cgutils.unpack_tuple(builder, values[0], len(arguments))
        values = [context.cast(builder, *given) for given in zip(values, called.args[0], arguments, strict=True)]
        kind = context.call_conv.get_function_type(returned, arguments)
        callee = cgutils.get_or_insert_function(builder.module, kind, symbol)
        status, result = context.call_conv.call_function(builder, callee, returned, arguments, values)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return result

    @intrinsic
    def call(typingctx: Any, *arguments: Any) -> Any:
        given = tuple(arguments[0]) if len(arguments) == 1 and isinstance(arguments[0], tuple) else arguments
        if len(given) != len(signature.args):
            raise TypeError(f"{made.__name__} takes {len(signature.args)} arguments, not {len(given)}")
        return signature.return_type(types.StarArgTuple(given)), generate

    return call
