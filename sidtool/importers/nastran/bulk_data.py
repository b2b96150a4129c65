"""Nastran bulk data (.bdf, .nas, .dat): solids, plane elements, shells, bars, springs,
their materials, sets, coordinate systems of nodes, RBE2, RBE3, MPC and masses.

Every card is read, listed as without effect on a linear elastic body, or refused.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ...mesh.connections import RawBar, RawEquation, RawShell, RawSpring
from ...mesh.deck_text import parse_integers
from ...mesh.imported_mesh import (
    LEFT_OUT,
    ONLY_NODES,
    ImportedMesh,
    MidsideNodes,
    RawCoupling,
    RawElement,
    assemble_mesh,
    check_unique_labels,
    find_undefined_members,
    linear_kind,
    mesh_of_points,
    reading_notes,
    unread_keyword_notes,
)
from ...mesh.reference_elements import reference_element
from .bar_sections import pbar, pbarl, pbeam, pbeaml, prod
from .bars import bar, bar_defaults, bars_of, fill_bar_defaults, with_rigid_twist
from .cards import CASE_CONTROL, Card, GridRun, SolidRun, current_cards, read_cards
from .constraints import (
    equations_of,
    read_case_control,
    read_mpc,
    read_mpcadd,
    read_rbar,
    read_rbe2,
    read_rbe3,
)
from .content import (
    ALTERNATIVES,
    WITHOUT_EFFECT,
    BulkData,
    CoordinateSystems,
    duplicate_error,
    property_node_sets,
    reorder_left_handed,
    systems_of,
)
from .laminates import mat2, mat8, pcomp, shells_of
from .masses import pmass, point_masses
from .properties import (
    check_membrane,
    check_no_extra_mass,
    corner_thicknesses,
    fields_after_nodes,
    material_name,
    materials_of,
    other_properties,
    read_mat1,
    read_mat9,
    read_pshear,
    read_pshell,
    read_psolid,
    thickness_of,
)
from .springs import pbush, pelas, spring, springs_of

#: Card -> our elements by their number of nodes.
_ELEMENTS = {
    "CTETRA": {4: "tet4", 10: "tet10"},
    "CHEXA": {8: "hex8", 20: "hex20"},
    "CPENTA": {6: "wedge6", 15: "wedge15"},
    "CPYRAM": {5: "pyramid5", 13: "pyramid13"},
    "CQUAD4": {4: "quad4"},
    "CTRIA3": {3: "tri3"},
    "CQUADR": {4: "quad4"},
    "CSHEAR": {4: "quad4"},
    "CTRIAR": {3: "tri3"},
    "CQUAD8": {8: "quad8"},
    "CTRIA6": {6: "tri6"},
}
#: Nastran has the upright edges before those of the top.
_ORDERS = {
    "hex20": (*range(12), *range(16, 20), *range(12, 16)),
    "wedge15": (*range(9), *range(12, 15), *range(9, 12)),
}


def read_bdf(
    path: str | Path,
    ignored: frozenset[str] = frozenset(),
    *,
    density: float | None = None,
    bending: bool = False,
) -> ImportedMesh:
    """Read the mesh of a Nastran bulk data file.

    Parameters
    ----------
    ignored : cards that are ignored on purpose, in capitals
    density : density of materials whose RHO is blank or zero, in the units of the file

    Raises
    ------
    InputError : the file is not valid; the error names file, line and expectation.
    """
    try:
        return _imported_mesh(bulk_data(Path(path), ignored, density=density), bending)
    except InputError as error:
        raise error.located(path) from None


def bulk_data(
    path: Path,
    ignored: frozenset[str],
    *,
    shells: bool = False,
    density: float | None = None,
) -> BulkData:
    """Read all cards of a file, with nodes in the basic system."""
    content = BulkData(shells=shells, density=density)
    stops = content.stops
    for written in read_cards(path):
        try:  # a context for each card would take as long as reading it
            for card in current_cards(written):
                _read_card(content, card, ignored)
        except InputError as error:
            stops.add(error)
    _check_temperatures(content)
    systems = {
        n: (content.system if s < 0 else s, p) for n, (s, p) in content.local.items()
    }
    local = {n: system for n, system in systems.items() if system[0]}
    content.frames = CoordinateSystems(dict(content.nodes), local, content.systems)
    for n in local:
        with stops.collect_errors():
            content.nodes[n] = content.frames.node(n)
    for system, place in content.direction_systems().items():
        with stops.collect_errors():
            content.frames.frame(system, place)
    content.masses = point_masses(content)
    content.bars = [fill_bar_defaults(content, card) for card in content.bars]
    content.name_only = property_node_sets(content)
    content.close_gaps()
    return content


def _read_card(content: BulkData, card: Card, ignored: frozenset[str]) -> None:
    if card.name in ignored:
        idle = card.name in WITHOUT_EFFECT
        content.unread_keywords[card.name if idle else f"{card.name}{LEFT_OUT}"] = None
    elif card.name in _ELEMENTS:
        _read_element(content, card)
    elif card.name in _READERS:
        _READERS[card.name](content, card)
    elif card.name in WITHOUT_EFFECT or ONLY_NODES in ignored:
        content.unread_keywords[card.name] = None
        content.heated |= card.name in ("TEMP", "TEMPD") and not content.controlled
    elif card.name in ("MATT1", "MATT2", "MATT3", "MATT8", "MATT9"):
        content.temperature_laws.append(card)
    else:
        _refuse(content, card)


def _refuse(content: BulkData, card: Card) -> None:
    error = InputError(
        f"{card.name} is not supported",
        place=card.place,
        expected=f"{ALTERNATIVES.get(card.name, 'bulk data without it')}; "
        f'geometry.ignore = ["{card.name}"] leaves it out',
    )
    content.stops.add(error, card.name)


def _check_temperatures(content: BulkData) -> None:
    """Refuse materials that depend on temperatures, if the file selects these."""
    for card in content.temperature_laws:
        if content.heated:
            _refuse(content, card)
        else:
            content.unread_keywords[f"{card.name} (no TEMPERATURE is selected)"] = None


def _read_grid(content: BulkData, card: Card) -> None:
    if isinstance(card, GridRun):
        _read_grids(content, card)
        return
    label = card.label(0, "a node")
    if label in content.nodes:
        raise duplicate_error("node", label, card)
    _only_zero(card, (7,), f"node {label} belongs to a superelement")
    place = card.integer(1, "a coordinate system", -1)
    if place < 0 and card.word(1):
        raise InputError(
            f"node {label} is in the coordinate system {place}",
            place=card.place,
            expected="0 or the number of a system",
        )
    what = "a coordinate"
    position = card.real(2, what), card.real(3, what), card.real(4, what)
    directions = card.integer(5, "a coordinate system", -1)
    content.nodes[label] = position
    content.local[label] = (place, card.place)
    content.turned[label] = directions
    if card.word(6):
        content.unread_keywords["PS of GRID (supports)"] = None


def _read_grids(content: BulkData, run: GridRun) -> None:
    if not content.nodes.keys().isdisjoint(run.labels):
        for label, place in zip(run.labels, run.places, strict=True):
            if label in content.nodes:
                raise duplicate_error("node", label, Card("GRID", place))
    content.nodes.update(zip(run.labels, run.positions, strict=True))
    given = zip(run.systems, run.places, strict=True)
    content.local.update(zip(run.labels, given, strict=True))
    content.turned.update(dict.fromkeys(run.labels, -1))


def _read_grdset(content: BulkData, card: Card) -> None:
    _only_zero(card, (7,), "gives all nodes a superelement")
    content.system = card.integer(1, "a coordinate system", 0)
    content.directions = card.integer(5, "a coordinate system", 0)
    if card.word(6):
        content.unread_keywords["PS of GRDSET (supports)"] = None


def _only_zero(card: Card, places: tuple[int, ...], problem: str) -> None:
    for i in places:
        if card.integer(i, "a number", 0):
            raise InputError(
                f"{problem} ({card.word(i)})",
                place=card.place,
                expected="nodes in the basic system",
            )


def _read_solids(content: BulkData, run: SolidRun) -> None:
    kind = _ELEMENTS[run.name].get(len(run.fields[0]) - 2)
    if kind is None or min(map(min, run.fields)) <= 0:
        for row, place in zip(run.fields, run.places, strict=True):
            with content.stops.collect_errors():
                _read_element(content, Card(run.name, place, list(map(str, row))))
        return
    nodes = [row[2:] for row in run.fields]
    order = _ORDERS.get(kind, range(len(nodes[0])))
    listed = [[row[i] for i in order] for row in nodes]
    content.elements += [
        (row[0], row[1], kind, own, place)
        for row, own, place in zip(run.fields, listed, run.places, strict=True)
    ]


def _read_element(content: BulkData, card: Card) -> None:
    if isinstance(card, SolidRun):
        _read_solids(content, card)
        return
    label = card.label(0, "an element")
    property_ = card.integer(1, "a property", label)
    most = max(_ELEMENTS[card.name])
    words = card.words[2 : 2 + most]
    while words and not words[-1]:
        words.pop()
    if "0" in words:
        words = ["" if word == "0" else word for word in words]
        while words and not words[-1]:
            words.pop()
    known = _ELEMENTS[card.name]
    full = known[most]
    corners = reference_element(full).corners
    kind = known.get(len(words))
    if len(words) == corners and kind is None:
        kind = linear_kind(full)
    elif len(words) > corners and "" not in words[:corners]:
        kind, words = full, [*words, *[""] * (most - len(words))]
    has_gap = kind == full and "" in words
    if kind is None or ("" in words and not (has_gap and not content.shells)):
        raise InputError(
            f"element {label} is a {card.name} of {len(words) - words.count('')} nodes",
            place=card.place,
            expected=" or ".join(map(str, _ELEMENTS[card.name])),
        )
    if all(map(str.isdecimal, words)):
        nodes = parse_integers(words, card.place, f"{card.name}: a node number")
    else:
        nodes = [
            card.integer(2 + i, "a node number") if word else 0
            for i, word in enumerate(words)
        ]
    flat = full in ("quad4", "tri3", "quad8", "tri6")
    angle = 4 if full == "quad8" else 0
    own = fields_after_nodes(full, card.words[2 + most :])
    if content.shells and flat and any(own[:angle] + own[angle + 1 :]):
        raise InputError(
            f"element {label} has an offset or thicknesses of its own",
            place=card.place,
            expected="shells in the middle of their thickness, which PSHELL gives",
        )
    if flat and any(thick := corner_thicknesses(full, own)):
        content.corners[label] = thick
    if flat:
        content.shell_fields[label] = own
    if card.name == "CSHEAR":
        content.panels.add(label)
        if content.shells:
            _refuse(content, card)
    order = _ORDERS.get(kind, range(len(nodes)))
    listed = [nodes[i] for i in order]
    content.elements.append((label, property_, kind, listed, card.place))


def _read_spc(content: BulkData, card: Card) -> None:
    for i in (1, 4):
        if card.word(i):
            _add_supports(content, card, card.word(i + 1), [card.word(i)])


def _read_spc1(content: BulkData, card: Card) -> None:
    _add_supports(content, card, card.word(1), card.words[2:])


def _add_supports(
    content: BulkData, card: Card, components: str, words: list[str]
) -> None:
    """Store supports as named nodes only, whatever directions they fix."""
    name = f"SPC{card.integer(0, 'a set')}"
    content.extend_set(name, words, card.place)
    if not {"1", "2", "3"} <= set(components):
        content.unread_keywords[f"directions of {name}: as a set it names nodes"] = None


def _read_set1(content: BulkData, card: Card) -> None:
    name = f"SET{card.integer(0, 'a set')}"
    if name in content.sets:
        raise duplicate_error("set", name, card)
    content.extend_set(name, card.words[1:], card.place)


def _read_system(content: BulkData, card: Card) -> None:
    for system in systems_of(card):
        if system.label in content.systems:
            raise duplicate_error("coordinate system", system.label, card)
        content.systems[system.label] = system


def _read_coupling(content: BulkData, card: Card) -> None:
    read = {"RBE2": read_rbe2, "RBAR": read_rbar, "RBE3": read_rbe3}[card.name]
    content.couplings.append(read(card))


def _read_mass(content: BulkData, card: Card) -> None:
    content.mass_cards.append(card)


def _read_mdlprm(content: BulkData, card: Card) -> None:
    if card.word(0).upper() not in ("HDF5", "OFFDEF"):
        raise InputError(
            f"MDLPRM {card.word(0)} is not supported",
            place=card.place,
            expected="MDLPRM HDF5 or OFFDEF, which touch neither mass nor stiffness",
        )
    content.unread_keywords[f"MDLPRM {card.word(0).upper()}"] = None


def _read_param(content: BulkData, card: Card) -> None:
    if card.word(0).upper() == "WTMASS":
        content.weight = card.real(1, "a factor", 1.0)
        return
    content.unread_keywords[f"PARAM {card.word(0).upper()}"] = None


_READERS: dict[str, Callable[[BulkData, Card], None]] = {
    "GRID": _read_grid,
    "GRDSET": _read_grdset,
    "PSOLID": read_psolid,
    "PSHELL": read_pshell,
    "PSHEAR": read_pshear,
    "MAT1": read_mat1,
    "MAT9": read_mat9,
    "MAT2": mat2,
    "MAT8": mat8,
    "PCOMP": pcomp,
    "PCOMPG": pcomp,
    **dict.fromkeys(("CELAS1", "CELAS2", "CBUSH"), spring),
    "PELAS": pelas,
    "PBUSH": pbush,
    **dict.fromkeys(("CBAR", "CBEAM", "CROD", "CONROD"), bar),
    **dict.fromkeys(("BAROR", "BEAMOR"), bar_defaults),
    "PBAR": pbar,
    "PBARL": pbarl,
    "PBEAM": pbeam,
    "PBEAML": pbeaml,
    "PROD": prod,
    "MPC": read_mpc,
    "MPCADD": read_mpcadd,
    CASE_CONTROL: read_case_control,
    "SPC": _read_spc,
    "SPC1": _read_spc1,
    "SET1": _read_set1,
    "PARAM": _read_param,
    **dict.fromkeys(("RBE2", "RBAR", "RBE3"), _read_coupling),
    **dict.fromkeys(("CONM1", "CONM2", "CMASS1", "CMASS2"), _read_mass),
    "PMASS": pmass,
    "MDLPRM": _read_mdlprm,
    **dict.fromkeys(("CORD2R", "CORD2C", "CORD2S"), _read_system),
    **dict.fromkeys(("CORD1R", "CORD1C", "CORD1S"), _read_system),
}


def _elements_by_property(content: BulkData) -> dict[str, list[int]]:
    """Elements by the number of their property."""
    parts: dict[str, list[int]] = {}
    for label, property_, *_ in content.elements:
        parts.setdefault(str(property_), []).append(label)
    for card in content.bars:
        if card.name != "CONROD":
            label = card.integer(0, "an element number")
            property_ = card.integer(1, "a property", label)
            parts.setdefault(str(property_), []).append(label)
    return parts


@cache
def _is_flat(kind: str) -> bool:
    return reference_element(kind).dimension == 2


def is_structure(content: BulkData) -> bool:
    """Return whether elements need rotational degrees of freedom, or have several
    dimensions.
    """
    flat = [e for e in content.elements if _is_flat(e[2])]
    solids = len(content.elements) - len(flat)
    if content.bars or content.springs or content.panels or (flat and solids):
        return True
    return any(
        content.properties[e[1]].layered for e in flat if e[1] in content.properties
    )


def _is_tilted(content: BulkData) -> bool:
    """Return whether plane elements are not in a plane z = constant."""
    used = {
        n for _, _, kind, nodes, _ in content.elements if _is_flat(kind) for n in nodes
    }
    z = [content.nodes[n] for n in used if n in content.nodes]
    return bool(z) and np.ptp(np.array(z)[:, 2]) > 1e-9 * np.ptp(z, axis=0).max()


def _check_axes(content: BulkData, coupling: RawCoupling) -> None:
    """Refuse single directions of nodes with their own axes."""
    if set(coupling.directions) in ({*"123"}, {*"456"}, {*"123456"}):
        return
    known = [n for n in coupling.nodes if n in content.nodes]
    turned = [n for n in known if content.direction_system(n)]
    if turned:
        raise InputError(
            f"{coupling.name} holds the directions {coupling.directions} of node "
            f"{turned[0]}, which are those of a system (CD)",
            place=coupling.place,
            expected="directions of the basic system, or all displacements",
        )


def _imported_mesh(content: BulkData, bending: bool) -> ImportedMesh:
    if bending or is_structure(content) or _is_tilted(content):
        return _structure(content)
    middles = _completed_middles(content)
    reorder_left_handed(content)
    stops, raw = content.stops, []
    equations: tuple[RawEquation, ...] = ()
    for label, property_, kind, nodes, place in content.elements:
        try:  # a context for each element would take as long
            given = content.properties.get(property_)
            check_membrane(content.shell_cards.get(property_))
            if given:
                check_no_extra_mass(given.extra, given.place)
            if _is_flat(kind):
                _note_plane(content, label, kind)
            material = material_name(content, given) if given else None
            depth = thickness_of(content, label, given, place)
            raw.append(RawElement(label, kind, nodes, place, material, depth))
        except InputError as error:
            stops.add(error)
    with stops.collect_errors():
        equations = equations_of(content, turning=False)
    for coupling in content.couplings:
        with stops.collect_errors():
            _check_axes(content, coupling)
    with stops.collect_errors():
        materials_of(content)
    stops.check()
    found = reading_notes(content.nodes, raw, len(raw))
    found += [*content.name_only, *_notes(content)]
    return ImportedMesh(
        assemble_mesh(content.nodes, raw, content.sets),
        materials_of(content),
        diagnostics=tuple(found),
        couplings=tuple(content.couplings),
        masses=tuple(mass.scaled(content.weight) for mass in content.masses),
        equations=(*equations, *middles.equations),
        parts=_elements_by_property(content),
        undefined=find_undefined_members(content.nodes, content.sets),
        straight=frozenset(middles.added.values()),
    )


def _completed_middles(content: BulkData) -> MidsideNodes:
    middles = MidsideNodes(content.nodes)
    for i, (label, property_, kind, nodes, place) in enumerate(content.elements):
        if 0 in nodes:
            completed = middles.completed(kind, nodes, place)
            content.elements[i] = (label, property_, *completed, place)
    content.nodes = middles.nodes
    return middles


def _note_plane(content: BulkData, label: int, kind: str) -> None:
    """List what plane elements do not have."""
    if content.shell_cards:
        content.unread_keywords["bending of PSHELL: its elements are plane"] = None
    if any(other_properties(kind, content.shell_fields.get(label, []))):
        content.unread_keywords[
            "further fields of plane elements (angles, offsets)"
        ] = None


def _notes(content: BulkData) -> list[Diagnostic]:
    found = []
    if content.weight != 1.0:
        replaced = f"densities by {content.weight:g} times those"
        factor = content.weight
        found.append(
            diagnose("N116", key="PARAM WTMASS", replaced=replaced, factor=factor)
        )
    return found + unread_keyword_notes(content.unread_keywords)


def _structure(content: BulkData) -> ImportedMesh:
    """Bars, shells, springs and solids whose nodes have six degrees of freedom."""
    flat = [e for e in content.elements if _is_flat(e[2])]
    shells: tuple[RawShell, ...] = ()
    springs: tuple[RawSpring, ...] = ()
    bars: tuple[RawBar, ...] = ()
    equations: tuple[RawEquation, ...] = ()
    stops = content.stops
    with stops.collect_errors():
        shells = shells_of(content)
    with stops.collect_errors():
        springs = springs_of(content)
    content.elements = [e for e in content.elements if not _is_flat(e[2])]
    middles = _completed_middles(content)
    reorder_left_handed(content)
    solids = []
    for label, property_, kind, nodes, place in content.elements:
        with stops.collect_errors():
            given = content.properties.get(property_)
            material = material_name(content, given) if given else None
            solids.append(RawElement(label, kind, nodes, place, material))
    with stops.collect_errors():
        equations = equations_of(content)
    with stops.collect_errors():
        bars, twists = with_rigid_twist(content, bars_of(content))
        equations = (*equations, *twists)
    for coupling in content.couplings:
        with stops.collect_errors():
            _check_axes(content, coupling)
    with stops.collect_errors():
        materials_of(content)
    stops.check()
    parts = _elements_by_property(content)
    for label, property_, *_ in flat:
        parts.setdefault(str(property_), []).append(label)
    everything: list[RawElement | RawShell | RawBar | RawSpring]
    everything = [*solids, *shells, *bars, *springs]
    check_unique_labels(everything)
    found = reading_notes(content.nodes, everything, len(everything))
    found += [*content.name_only, *_notes(content)]
    return ImportedMesh(
        assemble_mesh(content.nodes, solids, content.sets)
        if solids
        else mesh_of_points(content.nodes, content.sets),
        materials_of(content),
        diagnostics=tuple(found),
        couplings=tuple(content.couplings),
        masses=tuple(mass.scaled(content.weight) for mass in content.masses),
        equations=(*equations, *middles.equations),
        bars=bars,
        shells=shells,
        springs=springs,
        parts=parts,
        undefined=find_undefined_members(content.nodes, content.sets),
    )
