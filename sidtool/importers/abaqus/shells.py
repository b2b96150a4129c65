"""*SHELL SECTION of a deck: shells of corner nodes with homogeneous sections."""

from collections.abc import Mapping, Sequence

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import Material

from ...mesh.connections import RawShell, ShellSection
from ...mesh.deck_text import parse_numbers
from ...mesh.imported_mesh import check_defined, collapse_element
from ...mesh.materials import ElasticMaterial
from .deck import Deck, Element, Section
from .keywords import BY_CALCULIX, Block

#: Names of places of the nodes, as shares of the thickness from the middle.
_OFFSETS = {"SPOS": 0.5, "SNEG": -0.5}
#: Parameters that a deck needs CalculiX for.
_BEYOND = ("COMPOSITE", "NODAL THICKNESS")
#: Parameters without effect on small displacements of one homogeneous layer.
_IDLE = ("CONTROLS", "POISSON", "SECTION INTEGRATION", "STACK DIRECTION")
#: Share of the transverse shear stiffness of a homogeneous thickness.
_SHEAR_FACTOR = 5 / 6


def read_shell_section(deck: Deck, block: Block) -> None:
    """Read the thickness, the material and the offset of shells.

    Raises
    ------
    InputError : it has layers, a thickness of nodes, or none.
    """
    options = block.options
    if beyond := [key for key in _BEYOND if key in options]:
        raise InputError(
            f"*SHELL SECTION has {beyond[0]}, which is not supported",
            place=block.place,
            expected=f"one material and one thickness, or {BY_CALCULIX}",
        )
    words, place = block.rows[0] if block.rows else ([], block.place)
    thickness = parse_numbers(words[:1] or [""], place, "a thickness")[0]
    if thickness <= 0:
        raise InputError(
            f"*SHELL SECTION has the thickness {thickness:g}",
            place=place,
            expected="one above zero",
        )
    word = options.get("OFFSET", "0").upper()
    offset = _OFFSETS.get(word)
    if offset is None:
        offset = parse_numbers([word], block.place, "OFFSET")[0]
    deck.unread_keywords |= {
        f"{k} of *SHELL SECTION": None for k in _IDLE if k in options
    }
    elset, material = (deck.name(options.get(k, "")) for k in ("ELSET", "MATERIAL"))
    axes = options.get("ORIENTATION", "")
    deck.scope.sections.append(
        Section(
            elset,
            material,
            thickness,
            block.place,
            deck.own_name(axes) if axes else "",
            is_shell=True,
            offset=offset,
        )
    )


def shells_of(
    elements: Sequence[Element],
    sections: Mapping[int, Section],
    materials: Mapping[str, ElasticMaterial],
    nodes: Mapping[int, tuple[float, float, float]],
) -> tuple[RawShell, ...]:
    """Return the shells with their sections.

    Parameters
    ----------
    sections : by the labels of elements
    materials : by name, only complete ones

    Raises
    ------
    InputError : a material has directions, or a node is not defined.
    """
    made: dict[Section, ShellSection] = {}
    shells = []
    for element in elements:
        section = sections[element.label]
        if section not in made:
            made[section] = _shell_section(section, materials.get(section.material))
        kind, labels = collapse_element(element.type.shell_kind, element.nodes)
        check_defined(element.label, labels, nodes, element.place)
        own = made[section]
        shells.append(RawShell(element.label, kind, tuple(labels), element.place, own))
    return tuple(shells)


def _shell_section(section: Section, material: ElasticMaterial | None) -> ShellSection:
    t = section.thickness
    assert t is not None
    zero = np.zeros((3, 3))
    if material is None:
        shear = np.zeros((2, 2))
        return ShellSection(zero, zero, zero, shear, (0.0,) * 3, t, complete=False)
    if not isinstance(material, Material):
        raise InputError(
            f"material {section.material} of shells is not isotropic",
            place=section.place,
            expected=f"*ELASTIC of E and nu, or {BY_CALCULIX}",
        )
    e, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    law = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]]) * (e / (1 - nu**2))
    shear = _SHEAR_FACTOR * law[2, 2] * t * np.eye(2)
    masses = (rho * t, 0.0, rho * t**3 / 12)
    middle = ShellSection(law * t, zero, law * t**3 / 12, shear, masses, t)
    return middle.shifted(-section.offset * t)
