"""Derivatives of quantities of a body by numbers of its model."""

import time
from collections.abc import Iterable, Sequence

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile

from ..model_derivatives.design_variables import (
    ShapeVariable,
    VariableLike,
    full_key,
    matching_keys,
)
from ..model_derivatives.sid_derivatives import SidDerivatives, sid_derivatives
from ..sweep.design import unit_of_key
from .sensitivity_result import Sensitivities

#: Quantities where none are named.
DEFAULT_QUANTITIES = ("mass", "frequency(*)")


def model_sensitivities(
    model: ModelFile,
    variables: VariableLike | Iterable[VariableLike],
    quantities: str | Iterable[str] = DEFAULT_QUANTITIES,
) -> tuple[Sensitivities, SidDerivatives]:
    """Return derivatives of quantities of a body, and of its SID.

    Parameters
    ----------
    variables : keys of the model, several of them with commas, or NAME=KEY:FACTOR,...
    quantities : see `model_derivatives.quantities`

    Raises
    ------
    InputError : there is no such number or quantity.
    """
    started = time.perf_counter()
    derivatives = sid_derivatives(model, listed_variables(model, variables))
    found = derivatives.quantities(quantities)
    pairs = [
        [one.evaluate(derivatives.sid, derivatives[name]) for name in derivatives]
        for one in found
    ]
    table = np.array(pairs, float).reshape(len(found), len(derivatives), 2)
    units = {name: unit_of_key(model, full_key(model, name)) for name in derivatives}
    sensitivities = Sensitivities(
        functionals=tuple(one.text for one in found),
        variables=tuple(derivatives),
        values=table[:, 0, 0],
        point=np.array([derivatives.variables[name] for name in derivatives]),
        derivatives=table[:, :, 1],
        errors=np.full(table.shape[:2], np.nan),
        units=units | {one.text: one.unit for one in found},
        seconds=time.perf_counter() - started,
        title=model.title,
    )
    return sensitivities, derivatives


def listed_variables(
    model: ModelFile, given: VariableLike | Iterable[VariableLike]
) -> Sequence[VariableLike]:
    """Return variables, each once; keys may be listed with commas, and contain `*`.

    Raises
    ------
    InputError : there are none.
    """
    several = [given] if isinstance(given, str | ShapeVariable) else [*given]
    found: list[VariableLike] = []
    for one in several:
        if isinstance(one, str) and "=" not in one:
            for part in filter(None, map(str.strip, one.split(","))):
                found += matching_keys(model, part) if "*" in part else [part]
        else:
            found.append(one)
    if not found:
        raise InputError(
            "nothing is varied",
            place="--with",
            expected="a key such as material.youngs_modulus",
        )
    texts = [one for one in found if isinstance(one, str)]
    shapes = [one for one in found if not isinstance(one, str)]
    return [*dict.fromkeys(texts), *shapes]
