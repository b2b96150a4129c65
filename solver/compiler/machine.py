"""Machine code of kernels: what LLVM makes of them, and how it gets into a process.

numba turns a kernel and each that it calls into LLVM's language; they are put together
and translated as a whole, which leaves nothing to call but functions of the C library.
Only this is kept and loaded: a process that finds its kernels on disk does not ask
numba for anything.
"""

from __future__ import annotations

import platform
from functools import cache
from types import FunctionType
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm

from .inner import Unit, lock, unit_of
from .views import CHECKED

#: What machine code is called by.
NAME = "sidtool_kernel"
#: How names begin that are not of the C library.
PYTHON = "numba", "NRT_", "Py", "_Py"
_loaded: list[Any] = []


@cache
def environment() -> str:
    """The processor, and the versions of everything else that compiles."""
    versions = f"numba {numba.__version__} llvmlite {llvmlite.__version__}"
    python = f"{platform.python_implementation()} {platform.python_version()}"
    processor = f"{llvm.get_process_triple()} {' '.join(_processor())}"
    return f"{python} {versions} {processor}{' checked' if CHECKED else ''}"


@cache
def _processor() -> tuple[str, str]:
    """Name and features."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _new_target() -> Any:
    """What knows the processor. One that loads code is freed with what it loaded."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = _processor()
    return llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=cpu, features=features, opt=3, codemodel="jitdefault", jit=True
    )


_target = cache(_new_target)


def compiled(function: FunctionType, signature: Any) -> bytes:
    """The machine code of a kernel with all that it calls: an object file."""
    with lock:
        module = _together(unit_of(function, signature))
        _optimise(module)
        _refuse_python(function, module)
        code: bytes = _target().emit_object(module)
    return code


def _together(entry: Unit) -> Any:
    """One module, in which nothing but the entry is seen from outside."""
    module = llvm.parse_assembly("")
    for unit in entry.whole():
        module.link_in(llvm.parse_assembly(unit.text))
    for values in (module.functions, module.global_variables):
        for value in values:
            if not value.is_declaration and value.name != entry.name:
                value.linkage = "internal"
    module.get_function(entry.name).name = NAME
    return module


def _optimise(module: Any) -> None:
    """Loops here are short: to vectorise them takes longer, to compile and to run.

    To unroll them doubles the machine code and its cost, and saves no time in a step.
    """
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = False
    options.loop_unrolling = False
    builder = llvm.create_pass_builder(_target(), options)
    builder.getModulePassManager().run(module, builder)


def _refuse_python(function: FunctionType, module: Any) -> None:
    """Raises TypeError where a kernel may raise or allocate: nobody would be told."""
    names = [f.name for f in module.functions if f.is_declaration]
    left = [name for name in names if name.startswith(PYTHON)]
    if left:
        raise TypeError(f"{function.__qualname__} needs {', '.join(left)}")


def load(code: bytes) -> int:
    """The address of a kernel in this process, where it stays."""
    with lock:
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _new_target())
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        _loaded.append(engine)
        return int(engine.get_function_address(NAME))
