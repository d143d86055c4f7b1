"""How numba compiles a function that only other compiled functions call: as a part of them, or once for all of them.

Numba optimizes each function for itself, makes machine code of it, and does both again within each function that calls
it. Only the last of these is ever run.
"""

from __future__ import annotations

from typing import Any, Literal, cast

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering


class _Part(JITCodeLibrary):
    """The code of a function and of all that it calls, as those that call it take it over."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):
    _name = "lowering_of_parts"

    def run_pass(self, state: Any) -> Literal[True]:
        """Write the code of a function; no address stands for it, so that Python cannot call it."""
        context = state.targetctx
        state.library = library = _Part(context.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        state.flags.no_compile = True
        super().run_pass(state)
        name = [library].count  # some built-in function that is no other's: numba knows compiled functions by theirs
        context.insert_user_function(name, state["cr"].fndesc, [library])
        state["cr"] = state["cr"]._replace(cfunc=name)
        return True


class PartCompiler(CompilerBase):
    """Numba's own passes, with another last one."""

    lowering: Any = _Lowering

    def define_pipelines(self) -> list[Any]:
        """Return the passes."""
        passes: Any = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [(self.lowering if kind is NativeLowering else kind, why) for kind, why in passes.passes]
        passes.finalize()
        return [passes]


class _Linked(JITCodeLibrary):
    """The code of a function that others call by address, of which they take nothing over."""

    def _get_module_for_linking(self) -> Any:
        """Return, for the cache, what the code defines, by its names alone."""
        names = [made.name for made in self.get_defined_functions() if made.linkage == llvm.Linkage.external]
        return llvm.parse_assembly("\n".join(f'define void @"{name}"() {{ ret void }}' for name in names))


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class _LinkedLowering(NativeLowering):
    _name = "lowering_of_linked"

    def run_pass(self, state: Any) -> Literal[True]:
        """Write the code of a function."""
        state.library = _Linked(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        super().run_pass(state)
        return True


class LinkedCompiler(PartCompiler):
    """Of a function that is called by address, see `impactlaw.linked`."""

    lowering = _LinkedLowering
