"""``python -m benchmarks.validation``: reference problems, as docs/validation.md.

Every number has its source; no result is omitted because it deviates.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import sidtool

from .problems import Problem, Row, bodies, motions, rotors

PAGE = Path(__file__).parents[1] / "docs" / "validation.md"
PROBLEMS = (*bodies.PROBLEMS, *motions.PROBLEMS, *rotors.PROBLEMS)


def main() -> None:
    """Compute all problems and write the page."""
    parts = [
        "# Validation\n",
        "Reference problems with their deviations, written by `python -m "
        "benchmarks.validation`. *Published* numbers are printed in the source that is "
        "named, *computed* ones come from another method. Thirty more motions, every "
        "integrator and tolerance: [requested error and measured error]"
        "(../benchmarks/results/results.md).\n",
    ]
    for problem in PROBLEMS:
        parts += section(problem)
    versions = f"numpy {np.__version__}, sidtool {sidtool.__version__}"
    PAGE.write_text("\n".join([*parts, f"({versions})"]) + "\n", encoding="utf-8")


def section(problem: Problem) -> list[str]:
    """The lines of a problem: title, words, table."""
    title, *text = (problem.__doc__ or "").split("\n\n")
    print(title.rstrip("."))
    return [
        f"## {title.rstrip('.')}\n",
        *(" ".join(t.split()) for t in text),
        "",
        "| quantity | source | reference | sidtool | deviation |",
        "|---|---|---|---|---|",
        *map(_line, problem()),
        "",
    ]


def _line(row: Row) -> str:
    deviation = row.found - row.reference
    text = f"{deviation:+.1e}"
    if row.reference:
        text = f"{deviation / abs(row.reference):+.1e} relative"
    numbers = f"{row.reference:.10g} | {row.found:.10g} | {text}"
    return f"| {row.quantity} | {row.source} | {numbers} |"


if __name__ == "__main__":
    main()
