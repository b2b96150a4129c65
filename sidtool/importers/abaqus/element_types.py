"""Element types of Abaqus and CalculiX: own element, formulation, differences."""

from __future__ import annotations

import re
from dataclasses import dataclass

from sidtool.formats.base.errors import InputError

from ...mesh.reference_elements import ELEMENT_KINDS
from .keywords import BY_CALCULIX

#: Element type without its suffix -> our name.
_KINDS = {
    "C3D4": "tet4",
    "C3D5": "pyramid5",
    "C3D6": "wedge6",
    "C3D8": "hex8",
    "C3D10": "tet10",
    "C3D13": "pyramid13",
    "C3D15": "wedge15",
    "C3D20": "hex20",
    "CPS3": "tri3",
    "CPS4": "quad4",
    "CPS6": "tri6",
    "CPS8": "quad8",
    "CPE3": "tri3",
    "CPE4": "quad4",
    "CPE6": "tri6",
    "CPE8": "quad8",
}
#: Suffixes after the number of nodes.
_SUFFIXES = "IRHMTSEPLV"
#: Types of point masses and of their inertia.
POINTS = ("MASS", "ROTARYI")
#: Types of lines, triangles and quadrilaterals that pre-processors leave in a deck.
_LOWER = {
    **dict.fromkeys(POINTS, (0, 1)),
    **dict.fromkeys(("T2D2", "T3D2", "B21", "B31", "B31R", "SPRINGA"), (1, 2)),
    **dict.fromkeys(("T3D3", "T2D3", "B22", "B32", "B32R"), (1, 3)),
    **dict.fromkeys(("S3", "S3R", "M3D3", "STRI3", "SFM3D3", "R3D3"), (2, 3)),
    **dict.fromkeys(("S4", "S4R", "M3D4", "M3D4R", "SFM3D4", "R3D4"), (2, 4)),
    **dict.fromkeys(("S6", "STRI65", "M3D6", "SFM3D6"), (2, 6)),
    **dict.fromkeys(("S8", "S8R", "M3D8", "M3D8R", "SFM3D8"), (2, 8)),
}
#: Shells of corner nodes that a section makes elements of the body -> ours.
_SHELLS = {"S3": "tri3", "S3R": "tri3", "S4": "quad4", "S4R": "quad4"}


@dataclass(frozen=True)
class ElementType:
    """Meaning of an element type of a deck.

    Attributes
    ----------
    kind : our element, None for elements that only serve sets
    dimension, count : of the element, and of its nodes
    state : of a plane element
    formulation : of our element, if there is a choice
    replaced : differences from the deck, "" for none
    shell_kind : our shell element, "" for none
    """

    kind: str | None
    dimension: int
    count: int
    state: str | None = None
    formulation: str | None = None
    replaced: str = ""
    shell_kind: str = ""


def element_type(name: str) -> ElementType | None:
    """The type of this name in capitals; None for one that is not supported."""
    base = name.rstrip(_SUFFIXES)
    suffix = name[len(base) :]
    kind = _KINDS.get(base)
    if kind is None or kind not in ELEMENT_KINDS:
        lower = _LOWER.get(name)
        shell = _SHELLS.get(name, "")
        return None if lower is None else ElementType(None, *lower, shell_kind=shell)
    plane = base.startswith("CP")
    state = None
    if plane:
        state = "plane_stress" if base.startswith("CPS") else "plane_strain"
    formulation = None
    if kind in ("hex8", "quad4"):
        incompatible = "I" in suffix or "R" in suffix
        formulation = "incompatible_modes" if incompatible else "full_integration"
    count = int(kind.lstrip("abcdefghijklmnopqrstuvwxyz"))
    averaged = kind == "hex8" or (kind == "quad4" and state == "plane_strain")
    replaced = "; ".join(_replaced_properties(suffix, formulation, averaged))
    dimension = 2 if plane else 3
    return ElementType(kind, dimension, count, state, formulation, replaced)


def _replaced_properties(
    suffix: str, formulation: str | None, averaged: bool
) -> list[str]:
    """Describe differences from the deck; `averaged` if Abaqus uses B-bar."""
    notes = []
    if "R" in suffix:
        by = "full integration" if formulation is None else "incompatible modes"
        notes.append(f"reduced integration is replaced by {by}")
    if formulation == "full_integration" and averaged:
        notes.append("full integration as in CalculiX, without Abaqus' B-bar")
    if "H" in suffix:
        notes.append("the hybrid formulation is replaced by displacements alone")
    if "M" in suffix or ("I" in suffix and formulation is None):
        notes.append("the modified formulation is replaced by the plain one")
    if set(suffix) & set("TEPV"):
        notes.append("fields other than displacements are left out")
    return notes


#: Description of elements without an elastic body, and a remedy.
_FOREIGN = (
    (r"D$", "belongs to networks of fluids", "the elastic body alone"),
    (r"FC?3D", "is one of fluids", "the elastic body alone"),
    (r"(DC|DS|DG)[123CA]", "conducts heat only", "elements with displacements"),
    (r"CAX|SAX|MAX|RAX", "is axisymmetric", "the whole body in solids"),
    (r"CG?PEG|CGAX", "has generalised plane strain", "CPE or solids"),
    (r"SPRING|DASHPOT|GAP|CONN", "joins two points", "a force between markers"),
    (r"DCOUP", "couples nodes", "*COUPLING with *DISTRIBUTING"),
    (r"COH|C3D\d+P", "is not elastic alone", "elements with displacements"),
)


def unsupported_element_text(
    name: str, place: str, *, by_calculix: bool = False
) -> InputError:
    """Return a text that an element type is not supported, and the reason.

    Parameters
    ----------
    by_calculix : True if CalculiX should discretise the deck
    """
    for pattern, what, instead in _FOREIGN:
        if re.match(pattern, name):
            return InputError(
                f"element type {name} is not supported: it {what}",
                place=place,
                expected=instead,
            )
    return InputError(
        f"element type {name or '(none)'} is not supported",
        place=place,
        expected=_FOR_CALCULIX if by_calculix else supported_types(),
    )


def calculix_type(kind: str) -> str:
    """The element of CalculiX for one of ours, shells for plane ones.

    Raises
    ------
    InputError : there is no such element.
    """
    known_type = _IN_CALCULIX.get(kind)
    if known_type is None:
        raise InputError(f"CalculiX has no {kind}", expected=", ".join(_IN_CALCULIX))
    return known_type


_IN_CALCULIX = {
    "tri3": "S3",
    "quad4": "S4",
    "tri6": "S6",
    "quad8": "S8",
    "tet4": "C3D4",
    "tet10": "C3D10",
    "wedge6": "C3D6",
    "wedge15": "C3D15",
    "hex8": "C3D8I",
    "hex20": "C3D20",
}


_FOR_CALCULIX = "solids, or shells, beams and trusses of CalculiX, as S8R, B31, T3D2"


def supported_types() -> str:
    """The supported types, for a message."""
    known = ", ".join(base for base, kind in _KINDS.items() if kind in ELEMENT_KINDS)
    shells = ", ".join(_SHELLS)
    return f"{known}, {shells} with *SHELL SECTION, or {BY_CALCULIX}"
