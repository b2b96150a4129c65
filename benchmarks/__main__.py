"""``python -m benchmarks [NAME ...]``: measure, print, plot and write the page."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import click

from .machine import results_folder, use_one_thread

#: Modules with `run(folder, name, say) -> Report`, in the order of the page.
BENCHMARKS = (
    "slider_crank",
    "simeon",
    "four_bars",
    "flexible_machines",
    "integrators",
    "bdf",
    "spatial",
    "chain",
    "elastic",
    "reduction_methods",
    "calculix",
    "large_parts",
    "elements",
    "frontends",
    "q4_iga",
    "error_control",
    "body_frames",
    "revolutions",
    "metamorphic",
    "accuracy",
    "requests",
    "economy",
    "latency",
    "repeated",
    "derivatives",
    "body_derivatives",
    "fmu",
    "faults",
)
#: Also on the page: `python -m benchmarks.decks FOLDER -o benchmarks/results`.
ON_PAGE = (*BENCHMARKS, "decks")
#: Benchmarks with a summary in the documentation and in the README.
SHORT = ("slider_crank", "chain", "latency")
FIRST = ("slider_crank",)
#: Benchmarks that have a page of their own among the documents.
PAGES = ("q4_iga",)
ROOT = Path(__file__).parents[1]


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(BENCHMARKS))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=ROOT / "benchmarks" / "results",
    callback=results_folder,
    help="Folder of the results, default benchmarks/results.",
)
@click.option("--readme", is_flag=True, help="Write docs/speed.md and README.md, too.")
@click.option("--keep", is_flag=True, help="Measure nothing: write the last results.")
def main(names: tuple[str, ...], output: Path, readme: bool, keep: bool) -> None:
    """Measure speed against error beside other programs, one thread.

    All benchmarks, or those that are named. The page results.md holds the newest run
    of each. Programs that are not installed are left out.
    """
    use_one_thread()
    from .report import load, save, write_page, write_section

    for name in () if keep else names or BENCHMARKS:
        click.echo(f"{name}:")
        report = import_module(f"benchmarks.{name}").run(output, name, click.echo)
        save(output, name, report)
        click.echo(f"\n{report.text()}\n")
        write_page(output / "results.md", load(output, ON_PAGE))
    write_page(output / "results.md", load(output, ON_PAGE))
    click.echo(f"{output / 'results.md'} written")
    if readme:
        page = ROOT / "docs" / "speed.md"
        write_section(page, load(output, SHORT), note=True)
        write_section(ROOT / "README.md", load(output, FIRST))
        for name in PAGES:
            write_section(ROOT / "docs" / f"{name}.md", load(output, (name,)))
        click.echo("docs/speed.md and README.md updated")


if __name__ == "__main__":
    main()
