"""Numba compilers for functions that only compiled functions call: as parts of their callers, or linked by address.

By default numba optimizes each function and generates machine code for it, and does both again within each caller. The
code of the function itself is then never run.
"""

from __future__ import annotations

from typing import Any, Literal, cast

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering


class _Part(JITCodeLibrary):
    """The code of a function and of all functions it calls, in the form that callers inline; it is not optimized."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):
    _name = "lowering_of_parts"

    def run_pass(self, state: Any) -> Literal[True]:
        """Generate the code of a function without an address, so that Python cannot call it."""
        context = state.targetctx
        state.library = library = _Part(context.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        state.flags.no_compile = True
        super().run_pass(state)
        name = [library].count  # a unique built-in callable: numba identifies compiled functions by theirs
        context.insert_user_function(name, state["cr"].fndesc, [library])
        state["cr"] = state["cr"]._replace(cfunc=name)
        return True


class PartCompiler(CompilerBase):
    """Numba's compiler with another last pass, `lowering`."""

    lowering: Any = _Lowering

    def define_pipelines(self) -> list[Any]:
        """Return the passes."""
        passes: Any = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [(self.lowering if kind is NativeLowering else kind, why) for kind, why in passes.passes]
        passes.finalize()
        return [passes]


class _Linked(JITCodeLibrary):
    """The code of a function that others call by address and do not inline.

    It is optimized once, as a whole. Loops are not unrolled: most are over a few numbers, and unrolled loops do not get
    into the part that is faster.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        options = llvm.create_pipeline_tuning_options(speed_level=3)
        options.loop_vectorization = True
        options.loop_unrolling = options.loop_interleaving = options.slp_vectorization = False
        builder = llvm.create_pass_builder(self._codegen._tm, options)
        passes = builder.getModulePassManager()
        passes.add_refprune_pass()
        passes.run(self._final_module, builder)

    def _get_module_for_linking(self) -> Any:
        """Return a module for the cache that declares the external names of the code, with empty bodies."""
        names = [made.name for made in self.get_defined_functions() if made.linkage == llvm.Linkage.external]
        return llvm.parse_assembly("\n".join(f'define void @"{name}"() {{ ret void }}' for name in names))


@cast(Any, register_pass)(mutates_CFG=True, analysis_only=False)
class _LinkedLowering(NativeLowering):
    _name = "lowering_of_linked"

    def run_pass(self, state: Any) -> Literal[True]:
        """Generate the code of a function."""
        state.library = _Linked(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        super().run_pass(state)
        return True


class LinkedCompiler(PartCompiler):
    """The compiler of functions that are called by address, see `impactlaw.linked`."""

    lowering = _LinkedLowering
