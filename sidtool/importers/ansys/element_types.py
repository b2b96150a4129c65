"""Element types of ANSYS: own element, formulation, collapsed shapes."""

from __future__ import annotations

from collections.abc import Mapping

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose

#: ANSYS element type -> our name.
_ANSYS = {
    185: "hex8",
    45: "hex8",
    186: "hex20",
    95: "hex20",
    187: "tet10",
    92: "tet10",
    285: "tet4",
    182: "quad4",
    42: "quad4",
    183: "quad8",
    82: "quad8",
}
#: Integers before the nodes of an element: material, type, ..., nodes, unused, label.
HEADER_LENGTH = 11
#: Types that carry loads on surfaces, or only serve meshing.
WITHOUT_STIFFNESS = (153, 154, 200)
_PLANE = (182, 42, 183, 82)
#: Element type -> number of the KEYOPT that chooses its formulation.
_FORMULATION_KEY = {185: 2, 182: 1}
#: Value of that KEYOPT -> formulation, and what it replaces.
_FORMULATIONS = {
    0: ("full_integration", "B-bar is replaced by full integration"),
    1: ("incompatible_modes", "reduced integration is replaced by incompatible modes"),
    2: ("incompatible_modes", "enhanced strains are replaced by incompatible modes"),
    3: ("incompatible_modes", "enhanced strains are replaced by incompatible modes"),
}
#: Former element type -> number of the KEYOPT that is 1 without extra displacement
#: shapes (incompatible modes).
_EXTRA_SHAPES_KEY = {45: 1, 42: 2}
#: Distinct corners of a hexahedron -> our shape, and which of its corners these are.
_CORNERS = {
    4: ("tet", (0, 1, 2, 4)),
    5: ("pyramid", (0, 1, 2, 3, 4)),
    6: ("wedge", (0, 1, 2, 4, 5, 6)),
}
#: Then the middles, in the order of ANSYS: I-J, ..., M-N, ..., I-M, ...
_MIDDLES = {
    4: (8, 9, 11, 16, 17, 18),
    5: (8, 9, 10, 11, 16, 17, 18, 19),
    6: (8, 9, 11, 12, 13, 15, 16, 17, 18),
}


_CONTACT = (
    ", which is contact",
    "parts that share their nodes, or ties as CE and CP: ",
)
_SPRING = (", which is a spring", "a force in the scene between markers: ")
#: Types that are no solids: description, and a remedy.
_FOREIGN: dict[int | None, tuple[str, str]] = {
    **dict.fromkeys(range(169, 179), _CONTACT),
    **dict.fromkeys((14, 37, 39, 40), _SPRING),
    184: (", which is a joint or a rigid link", "a marker with a rigid tie: "),
}


def element_kind(
    given: int | None, keys: Mapping[int, int], label: int, place: str
) -> tuple[str, str | None, list[Diagnostic]]:
    """Our element, its formulation if there is a choice, and what is replaced.

    Raises
    ------
    InputError : the type is not supported.
    """
    plane = given in _PLANE
    if given not in _ANSYS or (plane and keys.get(3, 0) not in (0, 2, 3)):
        what, instead = _FOREIGN.get(given, ("", ""))
        raise InputError(
            f"element {label} is of type {given}{what}"
            + (f", KEYOPT(3) = {keys[3]}" if plane else ""),
            place=place,
            expected=instead + "one of " + ", ".join(map(str, _ANSYS)),
        )
    kind = _ANSYS[given]
    if given in _EXTRA_SHAPES_KEY:
        reduced = given == 45 and keys.get(2, 0) == 1
        suppressed = keys.get(_EXTRA_SHAPES_KEY[given], 0) == 1 and not reduced
        return kind, "full_integration" if suppressed else "incompatible_modes", []
    if given not in _FORMULATION_KEY:
        replaced = "reduced integration is replaced by full integration"
        if given != 183 and (given != 186 or keys.get(2, 0)):
            return kind, None, []
        return kind, None, [diagnose("N114", type=str(given), replacement=replaced)]
    key = _FORMULATION_KEY[given]
    option = keys.get(key, 0)
    formulation, replaced = _FORMULATIONS.get(option, _FORMULATIONS[0])
    name = f"{given}, KEYOPT({key}) = {option}"
    return kind, formulation, [diagnose("N114", type=name, replacement=replaced)]


def plane_state(kind: str, keys: Mapping[int, int]) -> str | None:
    """Return the plane state by KEYOPT(3) of an element; None for a solid."""
    if kind not in ("quad4", "quad8"):
        return None
    return "plane_strain" if keys.get(3, 0) == 2 else "plane_stress"


#: Corners of quadratic elements, which are linear where no edge has a middle node.
_LINEAR = {"hex20": ("hex8", 8), "tet10": ("tet4", 4), "quad8": ("quad4", 4)}


def collapsed_element(kind: str, nodes: list[int]) -> tuple[str, list[int]]:
    """The element whose coinciding nodes are one: prisms, pyramids, tetrahedra.

    Without middle nodes, absent or zero, it is the linear one.
    """
    linear, least = _LINEAR.get(kind, (kind, len(nodes)))
    if len(nodes) >= least and not any(nodes[least:]):
        kind, nodes = linear, nodes[:least]
    if kind == "quad4" and len(set(nodes)) == 3:
        return "tri3", list(dict.fromkeys(nodes))
    if kind == "quad8" and len(nodes) == 6:  # KEYOPT(1) = 1
        return "tri6", nodes
    if kind == "quad8" and len(nodes) == 8 and len(set(nodes[:4])) == 3:
        return "tri6", [nodes[i] for i in (0, 1, 2, 4, 5, 7)]
    if kind not in ("hex8", "hex20"):
        return kind, nodes
    distinct = len(dict.fromkeys(nodes[:8]))
    if distinct not in _CORNERS or len(nodes) not in (8, 20):
        return kind, nodes
    shape, corners = _CORNERS[distinct]
    places = corners + (_MIDDLES[distinct] if kind == "hex20" else ())
    return f"{shape}{len(places)}", [nodes[i] for i in places]


def check_element(values: list[int], place: str) -> None:
    """Check that an element has the announced number of nodes, and is alive.

    Raises
    ------
    InputError : the number differs, or the element is dead.
    """
    given = len(values) - HEADER_LENGTH
    if given < values[8] or any(values[HEADER_LENGTH + values[8] :]):
        raise InputError(
            f"element {values[10]} announces {values[8]} nodes and has {given}",
            place=place,
            expected="as many as it announces",
        )
    if values[5]:
        raise InputError(
            f"element {values[10]} is dead (EKILL)",
            place=place,
            expected="elements that are there",
        )
