"""Abaqus and CalculiX input files (.inp): nodes, elements, sets, materials.

Read are *NODE, *ELEMENT, *NSET, *ELSET, *MATERIAL with *ELASTIC and *DENSITY,
*SOLID SECTION and *INCLUDE; everything else (steps, loads, output) has no part in a
mesh. Materials that no section names, and properties that depend on temperature, are
left out. Parts with instances (*PART, *INSTANCE) are refused unless there is one part.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from formats.errors import InputError
from formats.model import Material

from .imported import (
    ImportedMesh,
    RawElement,
    assembled_mesh,
    integers,
    numbers,
    read_lines,
)

#: A generated set of more members is a damaged number.
_MOST_MEMBERS = 100_000_000
#: Element type without its suffixes -> our name.
_KINDS = {
    "C3D4": "tet4",
    "C3D6": "wedge6",
    "C3D5": "pyramid5",
    "C3D8": "hex8",
    "C3D10": "tet10",
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


@dataclass
class _Content:
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: list[tuple[int, str, list[int], str]] = field(default_factory=list)
    nsets: dict[str, list[int]] = field(default_factory=dict)
    elsets: dict[str, list[int]] = field(default_factory=dict)
    materials: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    sections: list[tuple[str, str, str]] = field(default_factory=list)
    states: set[str] = field(default_factory=set)
    thickness: float | None = None
    material: str = ""
    instances: int = 0
    spelling: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Block:
    """A keyword line with its data lines."""

    keyword: str
    options: dict[str, str]
    lines: list[tuple[str, str]]
    place: str


def read_inp(path: str | Path) -> ImportedMesh:
    """The mesh of an Abaqus or CalculiX input file.

    Raises
    ------
    InputError : names file, line and expectation.
    """
    try:
        content = _Content()
        for block in _blocks(Path(path), 0):
            reader = _READERS.get(block.keyword)
            if reader is not None:
                reader(content, block)
        return _imported(content)
    except InputError as error:
        raise error.located(path) from None


def _blocks(path: Path, depth: int) -> list[_Block]:
    blocks: list[_Block] = []
    pending = ""
    for number, line in enumerate(read_lines(path), start=1):
        text = line.strip()
        place = f"line {number}"
        if not text or text.startswith("**"):
            continue
        if not text.startswith("*"):
            if not blocks:
                raise InputError(
                    f"found {text[:40]!r} before any keyword",
                    source=path,
                    place=place,
                    expected="a line like *NODE",
                )
            blocks[-1].lines.append((text, place))
            continue
        pending += text
        if text.endswith(","):
            continue
        block = _keyword(pending, place)
        pending = ""
        if block.keyword == "INCLUDE":
            blocks += _included(path, block, depth)
            continue
        blocks.append(block)
    return blocks


def _included(path: Path, block: _Block, depth: int) -> list[_Block]:
    name = block.options.get("INPUT", "").strip('"')
    if not name or depth > 10:
        problem = "names no file" if not name else "includes itself"
        raise InputError(problem, place=block.place, expected="*INCLUDE, INPUT=FILE")
    return _blocks(path.parent / name, depth + 1)


def _keyword(text: str, place: str) -> _Block:
    words = [word.strip() for word in text[1:].split(",")]
    options = {}
    for word in words[1:]:
        name, _, value = word.partition("=")
        options[name.strip().upper()] = value.strip()
    return _Block(" ".join(words[0].upper().split()), options, [], place)


def _name(content: _Content, text: str) -> str:
    """Names are the same in any case; the first spelling is kept."""
    return content.spelling.setdefault(text.strip('"').upper(), text.strip('"'))


def _words(line: str) -> list[str]:
    return [word.strip() for word in line.split(",") if word.strip()]


def _nodes(content: _Content, block: _Block) -> None:
    if block.options.get("SYSTEM", "R").upper() not in ("R", ""):
        raise InputError(
            "uses a cylindrical or spherical system",
            place=block.place,
            expected="Cartesian coordinates",
        )
    labels = []
    for line, place in block.lines:
        words = _words(line)
        (label,) = integers(words[:1], place, "a node number")
        values = numbers(words[1:], place, "coordinates")
        if not 2 <= len(values) <= 3:
            raise InputError(
                f"node {label} has {len(values)} coordinates",
                place=place,
                expected="2 or 3",
            )
        if label in content.nodes:
            raise InputError(
                f"node {label} is defined twice", place=place, expected="one definition"
            )
        content.nodes[label] = (values[0], values[1], *values[2:], 0.0)[:3]  # type: ignore[assignment]
        labels.append(label)
    if "NSET" in block.options:
        name = _name(content, block.options["NSET"])
        content.nsets.setdefault(name, []).extend(labels)


def _elements(content: _Content, block: _Block) -> None:
    given = block.options.get("TYPE", "").upper()
    kind = _KINDS.get(given.rstrip("RHITSM") if given not in _KINDS else given)
    if kind is None:
        raise InputError(
            f"element type {given or '(none)'} is not supported",
            place=block.place,
            expected=", ".join(_KINDS),
        )
    if given.startswith("CP"):
        state = "plane_stress" if given.startswith("CPS") else "plane_strain"
        content.states.add(state)
    count = int("".join(c for c in kind if c.isdigit()))
    words: list[str] = []
    place = block.place
    labels = []
    for line, where in block.lines:
        place = where if not words else place
        words += _words(line)
        if len(words) > count:
            label, *nodes = integers(words, place, "element and node numbers")
            if len(nodes) > count:
                raise InputError(
                    f"element {label} ({given}) has {len(nodes)} nodes",
                    place=place,
                    expected=f"{count} nodes",
                )
            content.elements.append((label, kind, nodes, place))
            labels.append(label)
            words = []
    if words:
        raise InputError(
            f"element {words[0]} ({given}) has {len(words) - 1} nodes",
            place=place,
            expected=f"{count} nodes",
        )
    if "ELSET" in block.options:
        name = _name(content, block.options["ELSET"])
        content.elsets.setdefault(name, []).extend(labels)


def _members(
    content: _Content, block: _Block, option: str, sets: dict[str, list[int]]
) -> None:
    name = _name(content, block.options.get(option, ""))
    if not name:
        raise InputError("has no name", place=block.place, expected=f"{option}=NAME")
    group = sets.setdefault(name, [])
    for line, place in block.lines:
        words = _words(line)
        if "GENERATE" in block.options:
            values = integers(words, place, "first, last, step")
            first, last, step = (*values, 1)[:3] if len(values) > 1 else (1, 0, 0)
            if step < 1 or last < first or (last - first) // step > _MOST_MEMBERS:
                raise InputError(
                    f"found {line!r}", place=place, expected="first, last, step"
                )
            group.extend(range(first, last + 1, step))
            continue
        for word in words:
            if word.lstrip("-").isdigit():
                group.append(int(word))
            elif _name(content, word) in sets:
                group.extend(sets[_name(content, word)])
            else:
                raise InputError(
                    f"names the set {word!r}, which is not defined",
                    place=place,
                    expected="numbers or the name of a set above",
                )


def _nset(content: _Content, block: _Block) -> None:
    _members(content, block, "NSET", content.nsets)


def _elset(content: _Content, block: _Block) -> None:
    _members(content, block, "ELSET", content.elsets)


def _material(content: _Content, block: _Block) -> None:
    content.material = _name(content, block.options.get("NAME", ""))
    content.materials[content.material] = {}


def _property(content: _Content, block: _Block) -> None:
    if not block.lines or content.material not in content.materials:
        raise InputError(
            f"*{block.keyword} stands alone",
            place=block.place,
            expected="a *MATERIAL before it and a line of numbers after it",
        )
    kind = block.options.get("TYPE", "ISO").upper()
    if block.keyword == "ELASTIC" and not kind.startswith("ISO"):
        raise InputError(
            f"elasticity of type {kind} is not supported",
            place=block.place,
            expected="isotropic elasticity",
        )
    line, place = block.lines[0]
    values = numbers(_words(line), place)
    if len(block.lines) == 1:
        content.materials[content.material][block.keyword] = values


def _section(content: _Content, block: _Block) -> None:
    names = [_name(content, block.options.get(k, "")) for k in ("ELSET", "MATERIAL")]
    content.sections.append((names[0], names[1], block.place))
    if block.lines and block.lines[0][0].strip(", "):
        line, place = block.lines[0]
        value = numbers(_words(line)[:1], place)[0]
        content.thickness = value if value > 0 else None


def _instance(content: _Content, block: _Block) -> None:
    content.instances += 1
    if content.instances > 1 or block.lines:
        raise InputError(
            "several or displaced instances are not supported",
            place=block.place,
            expected="one part, or a flat input file",
        )


_READERS = {
    "NODE": _nodes,
    "ELEMENT": _elements,
    "NSET": _nset,
    "ELSET": _elset,
    "MATERIAL": _material,
    "ELASTIC": _property,
    "DENSITY": _property,
    "SOLID SECTION": _section,
    "INSTANCE": _instance,
}


def _imported(content: _Content) -> ImportedMesh:
    if len(content.states) > 1:
        raise InputError("mixes plane stress and plane strain", expected="one of them")
    materials = _materials(content)
    of_element: dict[int, str] = {}
    for elset, material, place in content.sections:
        if elset not in content.elsets:
            raise InputError(
                f"names the element set {elset!r}, which is not defined",
                place=place,
                expected="an *ELSET of this file",
            )
        if material not in content.materials:
            raise InputError(
                f"names the material {material!r}, which is not defined",
                place=place,
                expected="a *MATERIAL of this file",
            )
        for label in content.elsets[elset]:
            of_element[label] = material
    raw = [
        RawElement(label, kind, nodes, place, of_element.get(label))
        for label, kind, nodes, place in content.elements
    ]
    known = {label for label, *_ in content.elements}
    sets = dict(content.nsets)
    for name, members in content.elsets.items():
        wanted = known.intersection(members)
        nodes = {
            n for label, _, ns, _ in content.elements if label in wanted for n in ns
        }
        sets.setdefault(name, sorted(nodes))
    mesh = assembled_mesh(content.nodes, raw, sets)
    state = next(iter(content.states), None)
    return ImportedMesh(mesh, materials, state, content.thickness)


def _materials(content: _Content) -> dict[str, Material]:
    result = {}
    named = {material for _, material, _ in content.sections}
    for name, table in content.materials.items():
        if name not in named:
            continue
        elastic, density = table.get("ELASTIC"), table.get("DENSITY")
        if elastic is None or density is None or len(elastic) < 2:
            continue
        e, nu, rho = elastic[0], elastic[1], density[0]
        if e <= 0 or rho <= 0 or not -1 < nu < 0.5:
            raise InputError(
                f"material {name} has E = {e:g}, nu = {nu:g}, density {rho:g}",
                expected="E and density above zero, nu between -1 and 0.5",
            )
        result[name] = Material(youngs_modulus=e, poissons_ratio=nu, density=rho)
    return result
