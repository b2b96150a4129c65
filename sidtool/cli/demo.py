"""``sidtool demo``: the founding example from end to end."""

from __future__ import annotations

from pathlib import Path

import click

from .common import target


@click.command()
@click.option(
    "-o",
    "--output",
    type=target,
    default=Path("demo"),
    show_default=True,
    help="Folder for the plots, SIDs and results.",
)
def demo(output: Path) -> None:
    """Run the founding example: a slider-crank with a flexible rod, built twice.

    The rod goes from its geometry to a SID by bilinear quadrilaterals (Q4) and by
    isogeometric analysis (IGA). The frequencies stand beside the published ones, the
    mechanism is simulated with both rods, and speed is shown beside error. With
    `pip install "sidtool[view]"` motion.html in the folder plays it in a browser.
    """
    from ..demo import run_demo

    run_demo(output, click.echo)
