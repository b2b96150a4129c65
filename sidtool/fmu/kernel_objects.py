"""Object files of the kernels that a library is linked from.

They depend on the dimension of the scene, on the integrator and on the platform, not on
the scene. They are compiled once and cached on disk like the kernels of a run.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sidtool.formats.base.progress import report_stage
from sidtool.solver.compiler.kernels import Entry, Target
from sidtool.solver.compiler.precompile import find_kernel
from sidtool.solver.dynamics import output_quantities
from sidtool.solver.dynamics.equations_of_motion import kernels_by_name, law_value_at
from sidtool.solver.integrators import output_sampling
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.linear.factor_storage import KERNELS

from .platforms import PLATFORMS, parse_platforms
from .supported import UNIT_INTEGRATORS

#: How names of kernels begin in a library.
PREFIX = "sidtool_"


def called_kernels(planar: bool, integrator: str) -> dict[str, Entry]:
    """Kernels that the C sources call, by their names there."""
    method = INTEGRATORS[integrator]
    if planar:
        forces = output_quantities.write_forces_in_plane
        bodies = output_quantities.write_bodies_in_plane
    else:
        forces = output_quantities.write_forces_in_space
        bodies = output_quantities.write_bodies_in_space
    return {
        "advance": find_kernel(method.step_loop),
        "advance_past_singularity": find_kernel(method.singular_loop),
        "evaluate_start": output_sampling.evaluate_start,
        "sample": output_sampling.sample,
        "law_value_at": law_value_at,
        "write_forces": forces,
        "write_bodies": bodies,
    }


def library_kernels(planar: bool, integrator: str) -> Iterator[tuple[str, Entry, Any]]:
    """Symbol, kernel and signature of all kernels of a library."""
    for name, kernel in kernels_by_name(planar).items():
        yield PREFIX + name, kernel, KERNELS.members[name].signature
    for name, kernel in called_kernels(planar, integrator).items():
        yield PREFIX + name, kernel, kernel.signatures[0]


def precompile_units() -> int:
    """Compile the kernels of all units of this platform.

    Returns
    -------
    how many had to be compiled
    """
    (platform,) = parse_platforms(())
    target, count = PLATFORMS[platform].target, 0
    for planar in (True, False):
        for integrator in UNIT_INTEGRATORS:
            for symbol, kernel, signature in library_kernels(planar, integrator):
                if kernel.cached_code(signature, target, symbol) is None:
                    kernel.library_object(signature, target, symbol)
                    count += 1
    return count


def kernel_objects(planar: bool, integrator: str, target: Target) -> dict[str, bytes]:
    """Object files by symbol; they are compiled where they are not in the cache."""
    objects = {}
    kernels = list(library_kernels(planar, integrator))
    for k, (symbol, kernel, signature) in enumerate(kernels):
        report_stage(f"compiling for {target.triple}, once", k / len(kernels))
        objects[symbol] = kernel.library_object(signature, target, symbol)
    return objects
