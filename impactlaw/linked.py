"""Compiled functions that others call by address, so that they are compiled only once.

Numba copies the code of all called functions into each caller, and compiles it again there.
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
    """Return a decorator that compiles a function with one signature, to be called by compiled functions only.

    The function gets no wrapper for calls from Python, and the cache does not keep its code for inlining by callers.

    Args:
        signature: see `compiled`.
        counts: see `compiled`.
    """
    return lambda function: by_address(compiled(*signature, counts=counts, python=False)(function))


def by_address(function: Any) -> Any:
    """Return a numba intrinsic by which compiled functions call a compiled function with a single signature.

    Its attributes are the symbol of the function and its signature. The symbol, to which cached code refers, is defined
    here, before such code is loaded.
    """
    made = function.function if isinstance(function, Declared) else function
    symbol = f"impactlaw_{made.__module__.replace('.', '_')}_{made.__name__}"
    if isinstance(function, Declared):  # this process compiles its callers but does not run them
        signature = function.returned(*function.arguments)
        address = ctypes.cast(ctypes.pythonapi.Py_IncRef, ctypes.c_void_p).value
    else:
        (overload,) = function.overloads.values()
        signature = overload.signature
        address = overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name)
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

    by_symbol: Any = call
    by_symbol.symbol, by_symbol.signature = symbol, signature
    return by_symbol
