"""ANSYS archives (.cdb): solids and plane elements, materials, components of nodes.

Every command is read, listed as without effect on a linear elastic body, or refused.

Element types of ANSYS: own element, formulation, collapsed shapes.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ...mesh.deck_text import check_label, parse_integers, parse_numbers, read_lines
from ...mesh.imported_mesh import (
    LEFT_OUT,
    ONLY_NODES,
    ImportedMesh,
    MidsideNodes,
    RawElement,
    assemble_mesh,
    find_undefined_members,
    reading_notes,
    unread_keyword_notes,
)
from .constraints import (
    POINT_MASS,
    equations_of,
    point_mass,
    read_constant_block,
    read_constants,
    read_coupled,
    read_equation,
    real_thickness,
)
from .content import (
    ArchiveContent,
    material_name,
    materials_of,
    read_local,
    read_property,
    read_table,
)

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

#: Corners of quadratic elements, which are linear where no edge has a middle node.
_LINEAR = {"hex20": ("hex8", 8), "tet10": ("tet4", 4), "quad8": ("quad4", 4)}
#: Conditional commands; content that depends on a parameter must have no effect.
_BRANCHES = {"*IF": 1, "*ELSE": 0, "*ELSEIF": 0, "*ENDIF": -1}
#: Commands whose text may hold a $.
_TEXTS = ("C***", "/COM", "/TITLE", "!")
#: A line of a block that was refused or has no effect.
_DATA = re.compile(r"\s*[-+(\d]")
#: Integers and what follows them: (3i9,6e21.13e3), (2i9,19a9), (3i8,1p3e16.9).
_FORMAT = re.compile(
    r"\(\s*(\d*)i(\d+)(?:\.\d+)?\s*(?:,\s*(?:1p,?\s*)?(\d*)[adefg](\d+))?",
    re.IGNORECASE | re.ASCII,
)


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


#: Supports, loads, output and names, which do not change the body.
_IDLE = """
    /COM /PREP7 /SOLU /POST1 /NOPR /GOPR /GO /TITLE /UNITS /VIEW /AUTO /NERR /WB /OUT
    /CONFIG /BATCH /FILN /FILNAME *SET *GET FINI FINISH NUMOFF EXTOPT SHPP DSYS
    CSCIR DOF D DDELE DSYM F FDELE SF SFE SFL SFA SFDELE BF BFE BFUNIF
    TUNIF TREF TOFFST ACEL OMEGA DOMEGA CGLOC CGOMGA DCGOMG IRLF ANTYPE NLGEOM NSUBST
    DELTIM AUTOTS TIME OUTRES OUTPR KBC NCNV ERESX ALPHAD BETAD DMPRAT DMPSTR LSWRITE
    LSCLEAR SOLVE SAVE MODOPT MXPAND EQSLV BFDELE MPTEMP MPTGEN NROPT LNSRCH PRED TINTP
    CNVTOL CUTCONTROL MONITOR LUMPM PSTRES CNKMOD MODCONTROL QRDOPT KUSE NEQIT CRPLIM
    CGOMEGA TBTEMP TBDATA TBPT TBFIELD SFEBLOCK
"""
_WITHOUT_EFFECT = frozenset(_IDLE.split())
_IDLE_BLOCKS = frozenset(name for name in _WITHOUT_EFFECT if name.endswith("BLOCK"))


def read_cdb(
    path: str | Path,
    ignored: frozenset[str] = frozenset(),
    *,
    density: float | None = None,
) -> ImportedMesh:
    """Read the mesh of an ANSYS archive.

    Parameters
    ----------
    ignored : commands that are ignored on purpose, in capitals
    density : density of materials without DENS, in the units of the file

    Raises
    ------
    InputError : the file is not valid; the error names file, line and expectation.
    """
    try:
        content = ArchiveContent(read_lines(path), density=density)
        refused = False
        while content.at < len(content.lines):
            line = content.next()
            if refused and _DATA.match(line):
                continue
            before = content.stops.count
            with content.stops.collect_errors():
                _read_command(content, line, ignored)
            name = line.split(",")[0].strip().upper()
            passed = name in ignored or name in _IDLE_BLOCKS
            refused = passed or content.stops.count > before
        content.stops.check()
        return _imported_mesh(content)
    except InputError as error:
        raise error.located(path) from None


def _read_command(content: ArchiveContent, line: str, ignored: frozenset[str]) -> None:
    """Read the commands of a line, which are separated by $."""
    if "$" in line and not line.strip().upper().startswith(_TEXTS):
        for part in line.split("!")[0].split("$"):
            _read_command(content, part, ignored)
        return
    words = [word.strip() for word in line.split("!")[0].split(",")]
    if [word.upper() for word in words[1:2]] == ["UNBL"]:
        words[1] = "R5.0"  # the same fields, as CDWRITE names them since 2022
    name = words[0].upper().split(" ")[0]
    if not name or name.startswith("C***"):
        return
    if name in _BRANCHES:
        content.branches += _BRANCHES[name]
    elif "=" in name:
        content.unread_keywords["assignments of parameters"] = None
    elif name in _READERS and name not in ignored:
        if content.branches:
            raise InputError(
                f"{name} depends on a parameter",
                place=content.place,
                expected="an archive without *IF before what it says of the body",
            )
        try:
            _READERS[name](content, words)
        except InputError:
            raise
        except (LookupError, ValueError) as lack:
            raise InputError(
                f"{line.strip()!r} lacks entries of {name}",
                place=content.place,
                expected="all entries that CDWRITE writes",
            ) from lack
    elif name in ignored or name in _WITHOUT_EFFECT or ONLY_NODES in ignored:
        content.unread_keywords[
            name if name in _WITHOUT_EFFECT else f"{name}{LEFT_OUT}"
        ] = None
    else:
        error = InputError(
            f"{name} is not supported",
            place=content.place,
            expected=f'an archive without it; geometry.ignore = ["{name}"] leaves it '
            "out",
        )
        content.stops.add(error, name)


def _read_type(content: ArchiveContent, words: list[str]) -> None:
    """ET: number, type and KEYOPT 1 to 6 of an element type."""
    key, kind = parse_integers(words[1:3], content.place, "ET, number, type")
    content.types[key] = kind
    for i, word in enumerate(words[3:9], start=1):
        if word:
            content.options[key, i] = parse_integers([word], content.place)[0]


def _read_keyopt(content: ArchiveContent, words: list[str]) -> None:
    key, option, value = parse_integers(
        words[1:4], content.place, "KEYOPT, type, key, value"
    )
    content.options[key, option] = value


def _read_types(content: ArchiveContent, words: list[str]) -> None:
    """ETBLOCK: number, type and keys 1, 2, ... of every element type."""
    for whole, keys in _block_rows(content):
        key, kind = parse_integers(whole, content.place, "number and type")
        content.types[key] = kind
        for i, word in enumerate(keys, start=1):
            if word.strip():
                content.options[key, i] = parse_integers([word], content.place)[0]


def _block_rows(
    content: ArchiveContent, has_reals: bool = False
) -> Iterator[tuple[list[str], list[str]]]:
    """The integers and what follows them in the lines of a block, until its end.

    Blank integers before others are zero.

    Raises
    ------
    InputError : there is no format, or one without reals where there must be some.
    """
    match = _FORMAT.search(content.next())
    if match is None:
        wanted = "a line like (3i9,6e21.13e3)"
        raise InputError("has no format", place=content.place, expected=wanted)
    count, width, _, wide = (int(x) if x else 0 for x in match.groups())
    count = count or 1
    if has_reals and not wide:
        wanted = "numbers behind the integers, as in (3i9,6e21.13e3)"
        raise InputError("has no coordinates", place=content.place, expected=wanted)
    while True:
        line = content.next()
        start = line.strip().upper()
        if start == "-1" or start.startswith("N,"):
            return
        given = line[: count * width].rstrip()
        whole = [given[i : i + width] for i in range(0, len(given), width)]
        rest = line[count * width :] if wide else ""
        reals = [rest[i : i + wide] for i in range(0, len(rest.rstrip()), wide or 1)]
        yield [x if x.strip() else "0" for x in whole], reals


def _read_nblock(content: ArchiveContent, words: list[str]) -> None:
    before, announced = len(content.nodes), _announced_count(words)
    for whole, reals in _block_rows(content, has_reals=True):
        label = parse_integers(whole[:1] or [""], content.place, "a node number")[0]
        _add_node(content, label, reals)
    _check_count("NBLOCK", announced, len(content.nodes) - before)


def _announced_count(words: list[str]) -> int | None:
    last = words[-1]
    return int(last) if len(words) > 4 and is_label(last) else None


def _check_count(name: str, announced: int | None, count: int) -> None:
    if announced is not None and announced != count:
        raise InputError(
            f"{name} announces {announced} entries and holds {count}",
            expected="as many as it announces",
        )


def _add_node(content: ArchiveContent, label: int, words: list[str]) -> None:
    if label in content.nodes:
        what = f"node {label} is defined twice"
        raise InputError(what, place=content.place, expected="one definition")
    check_label(label, content.place, "a node")
    given = [word.strip() or "0" for word in words[:3]]
    x, y, z = (*parse_numbers(given, content.place, "coordinates"), 0.0, 0.0, 0.0)[:3]
    content.nodes[label] = (x, y, z)
    angles = [word.strip() or "0" for word in [*words[3:6], "", "", ""][:3]]
    turned = tuple(parse_numbers(angles, content.place, "angles"))
    if any(turned):
        content.turned[label] = turned


def _read_node(content: ArchiveContent, words: list[str]) -> None:
    """N, number, x, y, z, or as written by NWRITE: N,R5.3,LOC, number, x, y, z."""
    from_block = bool(words[1:2]) and words[1].upper().startswith("R5")
    if from_block:
        words = ["N", *words[3:]] if words[2].upper() == "LOC" else ["N", "-1"]
    label = parse_integers(words[1:2], content.place, "a node number")[0]
    system = content.current.get("CSYS", 0)
    if system and not from_block:
        raise InputError(
            f"node {label} is given in the coordinate system {system}",
            place=content.place,
            expected="N in the global Cartesian system (CSYS, 0)",
        )
    if label > 0:
        _add_node(content, label, words[2:8])


def _read_eblock(content: ArchiveContent, words: list[str]) -> None:
    if "SOLID" not in (word.upper() for word in words):
        raise InputError(
            "EBLOCK without SOLID is not supported",
            place=content.place,
            expected="EBLOCK, 19, SOLID",
        )
    before, announced = len(content.elements), _announced_count(words)
    for whole, _ in _block_rows(content):
        values = parse_integers(whole, content.place, "element data")
        wanted = content.elements[-1][0] if len(content.elements) > before else []
        if wanted and len(wanted) < HEADER_LENGTH + wanted[8]:
            wanted.extend(values)
            continue
        if len(values) < HEADER_LENGTH:
            raise InputError(
                f"has {len(values)} entries",
                place=content.place,
                expected=f"at least {HEADER_LENGTH}",
            )
        content.elements.append((values, content.place))
    _check_count("EBLOCK", announced, len(content.elements) - before)


def _set_current(name: str) -> Callable[[ArchiveContent, list[str]], None]:
    def read(content: ArchiveContent, words: list[str]) -> None:
        label = [word or "0" for word in words[1:2]] or ["0"]
        content.current[name] = parse_integers(label, content.place, name)[0]

    return read


def _read_single_element(content: ArchiveContent, words: list[str]) -> None:
    """EN, number, nodes, of the type and material here; EN,R5.5,ATTR,-1 is the end."""
    if words[1].upper().startswith("R5") and words[3:4] == ["-1"]:
        return
    label, *nodes = parse_integers([word for word in words[1:] if word], content.place)
    material, kind = (content.current.get(key, 1) for key in ("MAT", "TYPE"))
    real, system = content.current.get("REAL", 1), content.current.get("ESYS", 0)
    head = [material, kind, real, 1, system, 0, 0, 0, len(nodes), 0, label]
    content.elements.append(([*head, *nodes], content.place))


def _read_more_nodes(content: ArchiveContent, words: list[str]) -> None:
    """EMORE, nodes: further ones of the element above."""
    if not content.elements:
        raise InputError("EMORE stands alone", place=content.place, expected="EN")
    values, _ = content.elements[-1]
    nodes = parse_integers([word for word in words[1:] if word], content.place, "nodes")
    values.extend(nodes)
    values[8] += len(nodes)


def _read_component(content: ArchiveContent, words: list[str]) -> None:
    """CMBLOCK, name, kind, count: numbers, of which a negative one ends a range."""
    name, kind = words[1], words[2].upper() if len(words) > 2 else ""
    members: list[int] = []
    while (match := _FORMAT.search(content.next())) is None:
        continue
    width = int(match.group(2))
    count = parse_integers(words[3:4], content.place, "the number of entries")[0]
    read = 0
    while read < count:
        line = content.next().rstrip()
        parts = [line[i : i + width] for i in range(0, len(line), width)]
        for value in parse_integers(parts, content.place, "numbers"):
            read += 1
            first = members[-1] + 1 if value < 0 and members else value
            members.extend(range(first, -value + 1) if value < 0 else [value])
    if kind.startswith("NODE"):
        content.sets[name] = members
    elif kind.startswith("ELEM"):
        content.parts[name] = members
    else:
        content.unread_keywords[f"component {name} of {kind}"] = None


_READERS: dict[str, Callable[[ArchiveContent, list[str]], None]] = {
    "ET": _read_type,
    "ETBLOCK": _read_types,
    "KEYOP": _read_keyopt,
    "KEYOPT": _read_keyopt,
    "NBLOCK": _read_nblock,
    "EBLOCK": _read_eblock,
    "N": _read_node,
    "EN": _read_single_element,
    "TYPE": _set_current("TYPE"),
    "MAT": _set_current("MAT"),
    "REAL": _set_current("REAL"),
    "ESYS": _set_current("ESYS"),
    "EMORE": _read_more_nodes,
    **dict.fromkeys(("CSYS", "CLOCAL"), _set_current("CSYS")),
    "LOCAL": read_local,
    "CE": read_equation,
    "CP": read_coupled,
    "R": read_constants,
    "RLBLOCK": read_constant_block,
    "CMBLOCK": _read_component,
    "MP": read_property,
    "TB": read_table,
    "MPDATA": read_property,
}


def _imported_mesh(content: ArchiveContent) -> ImportedMesh:
    raw, masses, replaced = [], [], dict[Diagnostic, None]()
    middles = MidsideNodes(content.nodes)
    materials = materials_of(content)
    states = set[str | None]()
    for values, place in content.elements:
        key, label = values[1], values[10]
        nodes = values[HEADER_LENGTH : HEADER_LENGTH + values[8]]
        check_element(values, place)
        given = content.types.get(key)
        if given in WITHOUT_STIFFNESS:
            content.unread_keywords[f"elements of type {given}"] = None
            continue
        if given == POINT_MASS:
            masses.append(point_mass(content, values, place))
            continue
        keys = {i: value for (k, i), value in content.options.items() if k == key}
        kind, formulation, replacement = element_kind(given, keys, label, place)
        states.add(plane_state(kind, keys))
        name = material_name(values)
        ours, listed = middles.completed(*collapsed_element(kind, nodes), place)
        replaced |= dict.fromkeys(replacement)
        raw.append(
            RawElement(
                label,
                ours,
                listed,
                place,
                name if name in materials else str(values[0]),
                real_thickness(content, kind, keys, values[2], place),
                formulation,
            )
        )
    if len(states) > 1:
        raise InputError("mixes states of plane elements", expected="one of them")
    mesh = assemble_mesh(middles.nodes, raw, content.sets)
    found = [*reading_notes(middles.nodes, raw, len(raw)), *replaced]
    found += unread_keyword_notes(content.unread_keywords)
    labels = {element.label for element in raw}
    idle = {values[10] for values, _ in content.elements} - labels
    return ImportedMesh(
        mesh,
        materials,
        states.pop(),
        tuple(found),
        masses=tuple(masses),
        equations=(*equations_of(content), *middles.equations),
        parts={
            name: [label for label in content.parts[name] if label not in idle]
            for name in sorted(content.parts)
        },
        undefined=find_undefined_members(content.nodes, content.sets),
        straight=frozenset(middles.added.values()),
    )
