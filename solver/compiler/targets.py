"""Processors and formats that machine code is made for."""

from functools import cache
from typing import Any, NamedTuple

from llvmlite import binding as llvm

#: Name of the function in machine code.
ENTRY_SYMBOL = "sidtool_kernel"


class Target(NamedTuple):
    """Processor, and form of the machine code for it.

    Attributes
    ----------
    triple, processor, features
        As LLVM names them.
    in_process
        True for code that this process loads, False for objects of shared libraries.
    """

    triple: str
    processor: str
    features: str = ""
    in_process: bool = False


@cache
def host_target() -> Target:
    """The processor of this process, with all of its features."""
    features = llvm.get_host_cpu_features().flatten()
    name = llvm.get_host_cpu_name()
    return Target(llvm.get_process_triple(), name, features, in_process=True)


def new_machine(target: Target) -> Any:
    """Return the code generator of a target; it is freed with the code it loads."""
    if target.in_process:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        options = {"codemodel": "jitdefault", "jit": True}
    else:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        options = {"codemodel": "default", "reloc": "pic", "jit": False}
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.processor, features=target.features, opt=3, **options
    )


#: The code generator of a target, made once.
machine_of = cache(new_machine)
