"""Markers among nodes that are held: internal modes of elements do not move them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.model import ModelFile

from .finite_element_model import FiniteElementModel, MarkerRows


def as_their_nodes(body: FiniteElementModel, model: ModelFile) -> FiniteElementModel:
    """The body whose markers inside clamped or rigid faces move as these do.

    The internal modes of an element do not vanish between nodes that are at rest, where
    the body is: a marker there would move in the frame that it carries.
    """
    if all(marker.nodal is None for marker in body.markers):
        return body
    fixed = getattr(model.reduction, "fixed_names", ())
    clamped = (*getattr(model.frame, "clamped_edges", ()), *fixed)
    sets = [body.node_sets[name] for name in clamped if name in body.node_sets]
    groups = [np.concatenate(sets)] if sets else []
    held = [np.zeros(body.ndof, bool) for _ in (*groups, *body.rigid_sets)]
    for dofs, nodes in zip(held, (*groups, *body.rigid_sets.values()), strict=True):
        dofs[body.dofs(nodes)] = True
    markers = tuple(_settled(marker, held) for marker in body.markers)
    return replace(body, markers=markers)


def _settled(marker: MarkerRows, held: list[NDArray[np.bool_]]) -> MarkerRows:
    nodal = marker.nodal
    if nodal is None or not any(dofs[nodal.indices].all() for dofs in held):
        return marker
    return replace(marker, displacement=nodal, nodal=None)
