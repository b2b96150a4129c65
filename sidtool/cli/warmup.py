"""``sidtool warmup``: compile now what simulations would compile at their first use."""

from __future__ import annotations

import time

import click


@click.command()
def warmup() -> None:
    """Compile all kernels once, so that no simulation has to wait for it.

    Planar and spatial equations and all integrators, on all processors. The result is
    kept on disk, in the package or in your cache folder, or where the environment
    variable NUMBA_CACHE_DIR says; a changed scene compiles nothing, a new version of
    sidtool does.

    \b
    Example, after an installation:
      sidtool warmup && sidtool simulate slider_crank.toml -o motion.csv

    Exit status: 0 all kernels are on disk; 1 they cannot be kept.
    """
    from sidtool.solver.compiler.stored import unkept
    from sidtool.solver.integrators import all_step_loops
    from sidtool.solver.warmup import warm_up

    begin = time.perf_counter()
    count = warm_up(all_step_loops(), lambda line: click.echo(line, err=True))
    if count == 0:
        click.echo("all kernels are ready; there was nothing to compile")
        return
    click.echo(f"{count} kernels compiled in {time.perf_counter() - begin:.1f} s")
    if unkept():
        raise click.exceptions.Exit(1)
