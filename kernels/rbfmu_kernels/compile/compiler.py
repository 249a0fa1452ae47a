"""Numba's compiler reduced to what kernels need, which halves the time of a first call.

Numba makes machine code of a function, and also of each function that it calls, so that Python can call those too. The
kernels that a kernel calls are merged into its code: for them LLVM's intermediate code is enough.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from typing import Any, ClassVar, TypeAlias

from llvmlite import binding
from numba import njit, types

from ..types import Function
from . import numba_private as inside
from .code_cache import DiskCache, made_once
from .codegen import Context, Signature, Value

State: TypeAlias = Any  # Numba's StateDict, which passes share
Serialized = tuple[str, str, bytes]


class _Remembering(inside.Context):  # type: ignore[misc]
    """A typing context that remembers signatures of operations on numbers, for which Numba tries some ten templates."""

    _answers: ClassVar[dict[tuple[types.Type, tuple[types.Type, ...]], Signature]] = {}
    _numbers = (types.Number, types.Boolean, types.Literal)

    @classmethod
    def beside(cls, context: inside.Context) -> "_Remembering":
        """Return a view of Numba's own context; both share all their data."""
        view = object.__new__(cls)
        view.__dict__ = context.__dict__
        return view

    def resolve_function_type(
        self, func: types.Type, args: tuple[types.Type, ...], kws: dict[str, types.Type]
    ) -> object:
        if kws or not isinstance(func, types.Function) or not all(isinstance(a, self._numbers) for a in args):
            return super().resolve_function_type(func, args, kws)
        if (func, args) not in self._answers:
            with inside.ConfigStack().enter(_flags_for_all()):
                self._answers[func, args] = super().resolve_function_type(func, args, kws)
        return self._answers[func, args]


def _flags_for_all() -> inside.ConfigStack:
    """Return flags with which Numba's own functions, such as min, have the same code whichever kernel calls them first.

    They are merged into their callers. As separate functions they would have a different name in each process: a caller
    of two kernels that different processes have cached would contain two copies of each, and its bytes would depend on
    what was compiled before.
    """
    flags = inside.ConfigStack().top().copy()
    flags.forceinline = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    return flags


class _Lower(inside.Lower):  # type: ignore[misc]
    def lower_binop(self, resty: types.Type, expr: inside.ir.Expr, op: Function) -> Value:
        """Generate an operation's code by the signature of type inference, for which Numba would search again."""
        signature, context = self.fndesc.calltypes[expr], self.context
        known = (context.typing_context.resolve_value_type(op), signature.args)
        fixed = expr.static_lhs is not inside.ir.UNDEFINED or expr.static_rhs is not inside.ir.UNDEFINED
        if fixed or known not in _Remembering._answers:
            return super().lower_binop(resty, expr, op)
        operands = [
            context.cast(self.builder, self.loadvar(operand.name), self.typeof(operand.name), kind)
            for operand, kind in zip((expr.lhs, expr.rhs), signature.args, strict=True)
        ]
        found = context.get_function(known[0], _Remembering._answers[known])(self.builder, operands)
        return context.cast(self.builder, found, signature.return_type, resty)


@cache
def _no_processor() -> binding.TargetMachine:
    target = binding.Target.from_triple(binding.get_process_triple())
    return target.create_target_machine(cpu="", features="", opt=3)


@contextmanager
def _for_no_processor(codegen: inside.CPUCodegen) -> Iterator[None]:
    """Hide this machine's processor from LLVM: callees' code is also used in FMUs, whose bytes must not depend on it.

    No speed is lost: LLVM optimises a callee again, for this processor, in the caller into which it is merged.
    """
    own = codegen._tm
    codegen._tm = _no_processor()
    try:
        yield
    finally:
        codegen._tm = own


@inside.register_pass(mutates_CFG=True, analysis_only=False)
class _TypeInference(inside.NopythonTypeInference):  # type: ignore[misc]
    """Infers types, for which it compiles all callees, including Numba's own functions."""

    def run_pass(self, state: State) -> object:
        with _for_no_processor(state.targetctx.codegen()):
            return super().run_pass(state)


@inside.register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(inside.NativeLowering):  # type: ignore[misc]
    lowering_class = _Lower


_PASSES = (
    inside.TranslateByteCode, inside.FixupArgs, inside.DeadBranchPrune, inside.GenericRewrites, inside.ReconstructSSA,
    _TypeInference, inside.PreLowerStripPhis, inside.AnnotateTypes, _Lowering, inside.NoPythonBackend,
)  # fmt: skip


class _Passes(inside.PassManager):  # type: ignore[misc]
    """Runs passes without Numba's timers, events and checks, which take as long as some passes."""

    def _runPass(self, index: int, stage: inside.NativeLowering, state: State) -> None:
        stage.analysis = self._analysis
        stage.run_pass(state)


class KernelCompiler(inside.CompilerBase):  # type: ignore[misc]
    """A compiler without the passes for closures, `with`, `raise`, array expressions and literals."""

    def __init__(self, typingctx: inside.Context, *rest: object) -> None:
        super().__init__(typingctx, *rest)
        self.state.typingctx = _Remembering.beside(typingctx)

    def compile_extra(self, function: Function) -> inside.CompileResult:
        """Compile without garbage collection, which takes a tenth of the time and finds little."""
        collecting = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(function)
        finally:
            if collecting:
                _count_as_old()
                gc.enable()

    def define_pipelines(self) -> list[inside.PassManager]:
        """Return the one pipeline of a kernel."""
        passes = _Passes("kernel")
        for stage in _PASSES:
            passes.add_pass(stage, stage.__name__)
        passes.finalize()
        return [passes]


_FROZEN_BY_PYTHON = 1000
"""CPython 3.12 begins with some 400 frozen objects of its own; with more than this, the user has called `gc.freeze`."""


def _count_as_old() -> None:
    """Move all live objects to the oldest generation; otherwise the next collection takes a quarter of a second."""
    if gc.get_freeze_count() < _FROZEN_BY_PYTHON:
        gc.freeze()
        gc.unfreeze()


class CalleeCompiler(KernelCompiler):
    """A compiler of functions that only compiled code calls."""

    def __init__(self, typingctx: inside.Context, targetctx: Context, library: object, *rest: object) -> None:
        super().__init__(typingctx, targetctx, _IntermediateCode(targetctx.codegen(), "callee"), *rest)

    def compile_extra(self, function: Function) -> inside.CompileResult:
        """Compile for no particular processor."""
        with _for_no_processor(self.state.targetctx.codegen()):
            return super().compile_extra(function)


@cache
def _few_passes() -> binding.FunctionPassManager:
    passes = binding.create_new_function_pass_manager()
    passes.add_sroa_pass()
    passes.add_simplify_cfg_pass()
    passes.add_aggressive_dce_pass()
    return passes


class _IntermediateCode(inside.JITCodeLibrary):  # type: ignore[misc]
    @property
    def codegen(self) -> "_IntermediateCode":
        """Return this object, of which Numba only calls `set_env`."""
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Do nothing: exceptions and Python objects need an environment, kernels do not."""

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> object:
        return self.serialize_using_bitcode()

    def _optimize_functions(self, module: binding.ModuleRef) -> None:
        """Move variables from memory into registers; other optimisations are done once, in the caller."""
        if not hasattr(self._codegen, "_pass_builder"):  # Numba 0.61, whose LLVM cannot run such passes alone
            super()._optimize_functions(module)
            return
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if not function.is_declaration:
                _few_passes().run(function, self._codegen._pass_builder())

    def _optimize_final_module(self) -> None:
        """Merge callees into this code; other optimisations are done once, in the caller."""
        options = {"loop_vectorize": False, "slp_vectorize": False, "opt": 0, "cost": "cheap"}
        made = self._codegen._module_pass_manager(**options)
        if isinstance(made, tuple):
            passes, builder = made
            passes.run(self._final_module, builder)
        else:  # Numba 0.61, whose LLVM keeps unused globals: function addresses, with which code would not be cached
            made.add_aggressive_dead_code_elimination_pass()
            made.add_global_dce_pass()
            made.run(self._final_module)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @classmethod
    def _unserialize(cls, codegen: inside.CPUCodegen, state: Serialized) -> "_IntermediateCode":
        name, _, code = state
        library = cls(codegen, name)
        library._final_module = binding.parse_bitcode(code)
        library._finalize_final_module()
        return library


class _CalleeCacheImplementation(inside.CompileResultCacheImpl):  # type: ignore[misc]
    def rebuild(self, target_context: Context, payload: tuple[Any, ...]) -> inside.CompileResult:
        """Return cached code of `CalleeCompiler` as if compiled now; making machine code of it would change it."""
        state, description, environment, signature, *_ = payload
        library = _IntermediateCode._unserialize(target_context.codegen(), state)
        entry_point = target_context.get_executable(library, description, environment)
        return inside.compile_result(
            typing_context=target_context.typing_context, target_context=target_context, library=library,
            environment=environment, entry_point=entry_point, fndesc=description, signature=signature, objectmode=False,
        )  # fmt: skip


class CalleeCache(inside.FunctionCache):  # type: ignore[misc]
    """A cache of code that `CalleeCompiler` has made."""

    _impl_class = _CalleeCacheImplementation


# Kernels by these compilers


def reduced_kernel(function: Function, *, inline: bool) -> inside.Dispatcher:
    """Return the kernel of a function."""
    compiled = _njit(inline)(pipeline_class=pipeline)(function)
    if hasattr(compiled, "_cache"):  # not where the JIT is disabled
        _keep_on_disk(compiled, DiskCache(function))
        _compile_callees_bare(compiled, inline)
    return compiled


def loop(function: Function, signature: object) -> Any:
    """Return the function compiled now for one signature, cached until a kernel changes; it may allocate memory."""
    compiled = njit(error_model="numpy", nogil=True)(function)
    if hasattr(compiled, "_cache"):
        _keep_on_disk(compiled, DiskCache(function))
        compiled.compile(signature)
        compiled.disable_compile()
    return compiled


def _njit(inline: bool) -> Function:
    # _nrt: kernels allocate nothing, and counting references to a buffer costs half of a small model's step
    return partial(njit, error_model="numpy", nogil=True, forceinline=inline, _nrt=False)


def _keep_on_disk(dispatcher: inside.Dispatcher, kept: DiskCache) -> None:
    compiled = dispatcher.compile

    def compile_once(signature: Signature) -> object:
        if known := dispatcher.overloads.get(signature):  # locking a file would take longer than all else in a call
            return known.entry_point
        with made_once(kept):
            return compiled(signature)

    dispatcher._cache, dispatcher.compile = kept, compile_once


def _compile_callees_bare(compiled: inside.Dispatcher, inline: bool) -> None:
    """Give compiled callers a version of the function without machine code of its own and without Python's wrapper."""
    as_numba_does = compiled.get_call_template, compiled.get_overload

    @cache
    def template_and_overload() -> tuple[Function, Function]:
        if not internals_serve():
            return as_numba_does
        callee = _bare(compiled.py_func, inline)
        if not inline:  # to compile a function that is merged into its caller is faster than to store it
            _keep_on_disk(callee, DiskCache(compiled.py_func, CalleeCache))
        return callee.get_call_template, callee.get_overload

    @cache
    def template(args: tuple[types.Type, ...]) -> object:
        return template_and_overload()[0](args, {})

    def template_of(args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> object:
        args = tuple(map(types.unliteral, args))
        return template_and_overload()[0](args, kws) if kws else template(args)

    # A literal number gets no type of its own: one function is compiled for all, and LLVM propagates the constants.
    compiled.get_call_template = template_of
    compiled.get_overload = lambda sig: template_and_overload()[1](sig)


def _bare(function: Function, inline: bool) -> inside.Dispatcher:
    return _njit(inline)(pipeline_class=CalleeCompiler, **inside.CALLED_BY_CODE)(function)


def code_for_callers(function: Function, signature: Signature) -> inside.Dispatcher:
    """Return the function compiled for one signature, for compiled callers only: the same code on every processor."""
    compiler = CalleeCompiler if internals_serve() else inside.Compiler
    return njit(signature, pipeline_class=compiler, **inside.CALLED_BY_CODE)(function)


def pipeline(*state: object) -> inside.CompilerBase:
    """Return a function's compiler: that of kernels, or Numba's own if its internals do not behave as expected."""
    return (KernelCompiler if internals_serve() else inside.Compiler)(*state)


@cache
def internals_serve() -> bool:
    """Return whether Numba's internals compile a small kernel and its callee correctly; tried before all else."""
    callee = _bare(lambda x: x + 1.0, False)
    try:
        return bool(_njit(False)(pipeline_class=KernelCompiler)(lambda x: 2.0 * callee(x))(2.0) == 6.0)
    except Exception:
        return False
