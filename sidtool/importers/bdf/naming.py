"""Plane elements and bars that have no material beside solids: they name nodes.

Pre-processors such as Gmsh leave them behind for the surfaces and lines of a solid.
"""

from __future__ import annotations

from ...frontends.elements.reference import reference_element
from .content import BulkData

_CALLED = {1: "LINE", 2: "SURFACE"}


def named_apart(content: BulkData) -> tuple[str, ...]:
    """Make node sets SURFACE2, LINE1, ... of such elements, by their property.

    Returns
    -------
    a sentence on them, if there are some
    """
    dimensions = [
        reference_element(kind).dimension for _, _, kind, *_ in content.elements
    ]
    top = max(dimensions, default=1)
    elements, bars = [], []
    found: dict[str, list[int]] = {}
    for element, dimension in zip(content.elements, dimensions, strict=True):
        _, label, _, nodes, _ = element
        given = content.properties.get(label)
        if dimension == top or (given and given.flat and given.material):
            elements.append(element)
        else:
            found.setdefault(f"{_CALLED[dimension]}{label}", []).extend(nodes)
    for card in content.bars:
        label = card.integer(1, "a property", card.integer(0, "an element number"))
        if top == 1 or card.name == "CONROD" or label in content.bar_properties:
            bars.append(card)
        else:
            nodes = [card.integer(i, "a node") for i in (2, 3)]
            found.setdefault(f"{_CALLED[1]}{label}", []).extend(nodes)
    apart = len(content.elements) + len(content.bars) - len(elements) - len(bars)
    content.elements, content.bars = elements, bars
    for name, nodes in found.items():
        content.sets.setdefault(name, []).extend(nodes)
    if not apart:
        return ()
    return (
        f"{apart} elements of lower dimension have no material and only name nodes: "
        f"{', '.join(found)}",
    )
