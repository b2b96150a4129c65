"""Functional mock-up unit of a linearised mechanism, for model exchange, too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.base.sid import Array

from .export import check_version, model_identifier, unit_token, write_archive
from .linking import LINEAR_SOURCES, c_sources, choose_linker, link
from .model_description import FIRST_VARIABLE, UnitDescription, Variable
from .platforms import parse_platforms

if TYPE_CHECKING:
    from sidtool.solver.analyses.state_space import StateSpace

#: Numbers in a line of a table.
_PER_LINE = 4
#: Span and communication step that the description proposes [s].
_END, _STEP = 1.0, 1e-3


def export_linear_unit(
    space: StateSpace,
    path: Path,
    *,
    tool: str,
    version: str = "2.0",
    platforms: Sequence[str] = (),
    linker: str | None = None,
) -> None:
    """Write a state space as a functional mock-up unit.

    Inputs and outputs are those of the scene, not changes of these; states are changes
    from the operating point.

    Parameters
    ----------
    tool : name and version of this program, for the description
    version : of FMI, "2.0" or "3.0"
    platforms : names in `PLATFORMS`, by default that of this machine
    linker : "cc", "zig" or None for what is there

    Raises
    ------
    InputError : there is no such version or platform, or it cannot be linked.
    """
    names = parse_platforms(tuple(platforms))
    check_version(version)
    for name in names:
        choose_linker(name, linker)
    header = _matrices_header(space)
    token = unit_token(header, *c_sources(LINEAR_SOURCES).values())
    headers = {"matrices.h": header, "token.h": f'#define TOKEN "{token}"\n'}
    libraries = {
        name: link(name, headers, {}, linker, LINEAR_SOURCES) for name in names
    }
    identifier = model_identifier(path)
    description = UnitDescription(
        title=space.title or identifier,
        identifier=identifier,
        token=token,
        tool=tool,
        variables=_variables(space),
        start=0.0,
        end=_END,
        step=_STEP,
        tolerance=1e-6,
        is_linear=True,
    )
    write_archive(path, description, version, libraries)


def _variables(space: StateSpace) -> tuple[Variable, ...]:
    """Inputs, states, outputs and rates."""
    inputs = [
        Variable(name, unit, start=float(value))
        for name, unit, value in zip(
            space.input_names, space.input_units, space.inputs, strict=True
        )
    ]
    states = [
        Variable(f"states.{name}", unit, start=0.0, is_state=True)
        for name, unit in zip(space.state_names, space.state_units, strict=True)
    ]
    outputs = [
        Variable(name, unit)
        for name, unit in zip(space.output_names, space.output_units, strict=True)
    ]
    first = FIRST_VARIABLE + len(inputs)
    rates = [
        Variable(f"der({state.name})", _rate_unit(state.unit), rate_of=first + k)
        for k, state in enumerate(states)
    ]
    return (*inputs, *states, *outputs, *rates)


def _rate_unit(unit: str) -> str:
    return f"{unit}/s" if unit else "1/s"


def _matrices_header(space: StateSpace) -> str:
    """The matrices as constants of C."""
    tables = {
        "A": space.A,
        "B": space.B,
        "C": space.C,
        "D": space.D,
        "INPUTS": space.inputs,
        "OUTPUTS": space.outputs,
        "RATES": space.state_rates,
    }
    sizes = zip(
        ("N_STATES", "N_INPUTS", "N_OUTPUTS"),
        (len(space.A), len(space.inputs), len(space.outputs)),
        strict=True,
    )
    lines = (f"#define {name} {size}" for name, size in sizes)
    return "\n".join(chain(lines, *(_table(*item) for item in tables.items()))) + "\n"


def _table(name: str, values: Array) -> Iterable[str]:
    """A table of C, by rows; hexadecimal numbers are exact. One without entries has a
    zero, as C has no empty tables.
    """
    numbers = [float(x).hex() for x in np.ravel(values)] or ["0.0"]
    yield f"static const double {name}[{len(numbers)}] = {{"
    for first in range(0, len(numbers), _PER_LINE):
        yield f"    {', '.join(numbers[first : first + _PER_LINE])},"
    yield "};"
