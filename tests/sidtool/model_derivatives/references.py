"""Derivatives by central differences, and SIDs as arrays, to compare with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sidtool.formats.base.sid import NODE_SHAPES, SID
from sidtool.formats.model import ModelFile
from sidtool.model_derivatives.design_variables import VariableLike, design_variable

#: Coefficients of the central difference of fourth order.
_WEIGHTS = {1: 2 / 3, 2: -1 / 12}


def central_difference(
    model: ModelFile,
    variable: VariableLike,
    quantities: Callable[[ModelFile], dict[str, Any]],
    relative: float = 3e-3,
) -> dict[str, Any]:
    """Return derivatives of quantities of a model by a variable, of fourth order.

    Parameters
    ----------
    relative : step relative to the variable; of variables at zero in units of 0.02
    """
    found = design_variable(model, variable)
    step = relative * (abs(found.value) or 0.02)
    total: dict[str, Any] = {}
    for distance, weight in _WEIGHTS.items():
        for sign in (1, -1):
            moved = found.moved(model, sign * distance * step)
            for name, value in quantities(moved).items():
                term = value * (sign * weight / step)
                total[name] = total[name] + term if name in total else term
    return total


def arrays(sid: SID) -> dict[str, Any]:
    """Return all numbers of a SID by name: mass, blocks, entries of nodes."""
    found: dict[str, Any] = {"mass": np.array(sid.mass)}
    entries = [(name, block) for name, block in sid.blocks.items()]
    for node in sid.nodes:
        entries += [(f"{node.id}.{name}", getattr(node, name)) for name in NODE_SHAPES]
    for name, block in entries:
        if block is not None:
            found[name] = block.m0
            if block.m1 is not None:
                found[f"{name} m1"] = block.m1
    return found


def natural_sizes(sid: SID) -> dict[str, float]:
    """Return the size that an entry of each block may have, from mass and length."""
    length = max(np.abs(node.position).max() for node in sid.nodes)
    root, (phi, psi) = np.sqrt(sid.mass), sid.largest_shapes
    of_block = {
        **dict.fromkeys(("Me", "Ge", "Cr m1", "Oe m1"), 1.0),
        **dict.fromkeys(("Ct", "mdCM m1"), root),
        **dict.fromkeys(("Cr", "Gr", "Oe", "J m1"), root * length),
        "mass": sid.mass,
        "mdCM": sid.mass * length,
        "J": sid.mass * length**2,
        "Ct m1": sid.mass * phi,
        "ksigma": np.abs(sid.Ke.m0).max() * 1e-3,
        "De": 1e-300,
    }
    of_node = {"origin": length, "phi": phi, "psi": psi, "AP": psi}
    of_node |= {"origin m1": phi, "AP m1": psi}
    found = {}
    for name, value in arrays(sid).items():
        kind = name.rpartition(".")[2]
        size = of_block.get(name, 0.0) if kind == name else of_node.get(kind, 0.0)
        found[name] = max(float(np.abs(value).max(initial=0.0)), size)
    return found


def largest_difference(
    found: SID, expected: dict[str, Any], values: SID, unit: float
) -> tuple[float, str]:
    """Return the largest error of a derivative of a SID, and the block that has it.

    Errors are relative to the largest entry of a derivative, or to a hundredth of the
    size of its block per unit of the variable.
    """
    sizes = natural_sizes(values)
    worst = (0.0, "")
    for name, value in arrays(found).items():
        reference = expected.get(name, 0.0)
        floor = 1e-2 * sizes.get(name, 1.0) / unit
        size = max(np.abs(reference).max(initial=0.0), floor, 1e-300)
        error = np.abs(value - reference).max(initial=0.0) / size
        worst = max(worst, (float(error), name))
    return worst
