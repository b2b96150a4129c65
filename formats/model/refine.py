"""Refinement of a model: finer meshes, more shape functions."""

import math
from collections.abc import Collection
from typing import Any

from . import ModelFile
from .discretisation import (
    BeamDiscretisation,
    IgaDiscretisation,
    Q4Discretisation,
    SolidDiscretisation,
)
from .reduction import AttachmentReduction, ModalReduction


def refine_model(model: ModelFile, level: int) -> ModelFile | None:
    """The model with elements of 1/2^level of the size in each direction.

    Negative levels make larger elements, one in each direction at least.

    None for a mesh or matrices, which stay as they are, and for knots without equal
    spans, which cannot be made larger.
    """
    if level == 0:
        return model
    discretisation, times = model.discretisation, 2.0**level
    if isinstance(discretisation, Q4Discretisation | SolidDiscretisation):
        changes: dict[str, Any] = {
            "elements": tuple(_scaled_counts(n, times) for n in discretisation.elements)
        }
    elif isinstance(discretisation, BeamDiscretisation):
        changes = {"elements": _scaled_counts(discretisation.elements, times)}
    elif (
        isinstance(discretisation, IgaDiscretisation)
        and discretisation.knots is not None
        and level < 0
    ):
        return None
    elif isinstance(discretisation, IgaDiscretisation):
        knots = getattr(model.geometry, "knots", ())
        changes = _refined_knots(
            discretisation, times, knots, getattr(model.geometry, "degrees", ())
        )
    else:
        return None
    finer = discretisation.model_copy(update=changes)
    return model.model_copy(update={"discretisation": finer})


def with_modes(model: ModelFile, count: int) -> ModelFile | None:
    """The model with so many normal modes; None where the method counts none."""
    if not hasattr(model.reduction, "modes"):
        return None
    reduction = model.reduction.model_copy(update={"modes": count})
    return model.model_copy(update={"reduction": reduction})


def with_static_shapes(model: ModelFile, nodes: Collection[int]) -> ModelFile | None:
    """The model with static answers to forces and moments at nodes, and to the loads of
    its own inertia, beside its modes.

    None where it has no normal modes alone, or no marker at these nodes. The markers of
    a chord turn, and the second one moves along it.
    """
    frame = model.frame
    clamped = frame.marker_names if frame.clamped_edges else ()
    on_nodes = [name for name, marker in model.markers.items() if marker.node in nodes]
    names = tuple(name for name in on_nodes if name not in clamped) or tuple(on_nodes)
    if not isinstance(model.reduction, ModalReduction) or not names:
        return None
    reduction = AttachmentReduction(
        interfaces=names,
        modes=model.reduction.modes,
        fix=model.reduction.fix,
        centrifugal=True,
    )
    return model.model_copy(update={"reduction": reduction})


def requested_modes(model: ModelFile) -> int | None:
    """How many normal modes a model asks for; None where the method counts none."""
    modes = getattr(model.reduction, "modes", None)
    return modes if isinstance(modes, int) else None


def _refined_knots(
    discretisation: IgaDiscretisation,
    times: float,
    knots: tuple[tuple[float, ...], ...],
    degrees: tuple[int, ...],
) -> dict[str, Any]:
    """Each knot span cut into so many equal ones.

    knots, degrees : of the geometry, if there is one patch
    """
    if discretisation.elements is not None:
        return {
            "elements": tuple(_scaled_counts(n, times) for n in discretisation.elements)
        }
    if discretisation.functions is not None:
        repeated = [0] * len(discretisation.functions)
        for i, (row, own) in enumerate(zip(knots, degrees, strict=True)):
            inner = [k for k in row if row[0] < k < row[-1]]
            smoother = (discretisation.degrees[i] - own - 1) * len(set(inner))
            repeated[i] = len(inner) + smoother
        triples = zip(
            discretisation.functions, discretisation.degrees, repeated, strict=True
        )
        return {
            "functions": tuple(
                _scaled_counts(max(n - p - r, 1), times) + p + r for n, p, r in triples
            )
        }
    assert discretisation.knots is not None
    return {
        "knots": tuple(_insert_knots(row, round(times)) for row in discretisation.knots)
    }


def _scaled_counts(elements: int, times: float) -> int:
    """So many times as many, rounded up."""
    return math.ceil(elements * times)


def _insert_knots(knots: tuple[float, ...], times: int) -> tuple[float, ...]:
    finer: list[float] = []
    for a, b in zip(knots, knots[1:], strict=False):
        finer.append(a)
        if b > a:
            finer += [a + (b - a) * k / times for k in range(1, times)]
    return (*finer, knots[-1])
