"""Free body of a CalculiX deck: without steps, supports, loads and point masses."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..mesh.deck_text import (
    IncludedFiles,
    RefusalCollector,
    named_file,
    parse_numbers,
    read_lines,
)
from ..mesh.imported_mesh import ONLY_NODES
from .abaqus.deck import POINTS, Namespace
from .abaqus.input_file import read_deck

#: Supports, which the frame of the model file replaces, and point masses, which are
#: added to the matrices: CalculiX would couple them to shells and beams by equations.
_LEFT_OUT = ("BOUNDARY", "BOUNDARYF", "SUBMODEL", "MASS", "ROTARYINERTIA")
#: Numbers of an element in its first line.
_PER_LINE = 12
#: Characters of a number that CalculiX reads.
_MAX_NUMBER_LENGTH = 20
#: Generation that CalculiX does not have, and its replacement.
_GENERATION = ("NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY")
_NAMING = ("NODE", "SYSTEM", "ELEMENT", "NSET", "ELSET", *_GENERATION)
#: What ends the keywords of a material.
_AFTER_MATERIALS = (
    *("MATERIAL", "SOLIDSECTION", "SHELLSECTION", "BEAMSECTION", "MEMBRANESECTION"),
    *("NODE", "ELEMENT", "NSET", "ELSET", "ORIENTATION", "STEP", "SURFACE", "MASS"),
    *("AMPLITUDE", "BEAMGENERALSECTION", "EQUATION", "MPC", "TRANSFORM", "TIE"),
    *("NODALTHICKNESS", "NORMAL", "RIGIDBODY", "COUPLING", "PHYSICALCONSTANTS"),
)
#: Keywords with which a deck is not one free, linear body.
_REFUSED = {
    "CONTACTPAIR": "one body without contact",
    "CYCLICSYMMETRYMODEL": "a mesh of the whole body",
    "PRE-TENSIONSECTION": "a deck without bolts under tension",
    "DISTRIBUTING": "a marker with a distributing tie: CalculiX couples forces alone",
    "GAP": "one body without contact",
    "PART": "a flat deck, as CalculiX reads it",
    "INSTANCE": "a flat deck, as CalculiX reads it",
    "USERMATERIAL": "a linear elastic material",
}


def free_deck(path: Path, ignored: frozenset[str] = frozenset()) -> list[str]:
    """Return the lines of a deck with its included files, without steps, supports,
    masses.

    Parameters
    ----------
    ignored : keywords that are ignored on purpose, in capitals

    Raises
    ------
    InputError : a file cannot be read, or a keyword makes it more than one body.
    """
    dropped = {"".join(word.split()) for word in (*_LEFT_OUT, *ignored)}
    lines = list(_deck_lines(path, IncludedFiles()))
    result: list[str] = []
    if any(_is_generation(text) for text, _ in lines):
        dropped |= set(_NAMING)
        body = read_deck(path, frozenset((ONLY_NODES,))).assembly
        result += [_shorten_line(text) for text in _explicit_lines(body)]
    stops, keep, in_step = RefusalCollector(), True, False
    for text, place in lines:
        if text.startswith("**"):
            continue
        if text.startswith("*"):
            keyword = _keyword_of(text)
            in_step = keyword == "STEP" or (in_step and keyword != "ENDSTEP")
            keep = not in_step and keyword != "ENDSTEP" and keyword not in dropped
            keep = keep and not _is_mass_element(text)
            if keep and keyword in _REFUSED:
                name = text[1:].split(",")[0].strip().upper()
                error = InputError(
                    f"*{name} is not supported",
                    source=path,
                    place=place,
                    expected=_REFUSED[keyword],
                )
                stops.add(error, name)
        if keep:
            result.append(text if text.startswith("*") else _shorten_line(text))
    stops.check()
    return result


def _explicit_lines(body: Namespace) -> Iterator[str]:
    """The nodes, elements and sets of a deck without generation."""
    yield "*NODE"
    yield from (f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in body.nodes.items())
    for element in body.elements.values():
        if element.given in POINTS:
            continue
        yield f"*ELEMENT, TYPE={element.given}"
        words = [str(n) for n in (element.label, *element.nodes)]
        yield ", ".join(words[:_PER_LINE]) + ("," if words[_PER_LINE:] else "")
        yield from [", ".join(words[_PER_LINE:])] if words[_PER_LINE:] else []
    for kind, sets in (("NSET", body.nsets), ("ELSET", body.elsets)):
        for name, group in sets.items():
            yield f"*{kind}, {kind}={name}"
            yield from (f"{label}," for _, label in dict.fromkeys(group))


def _is_generation(text: str) -> bool:
    """Return whether a line generates nodes or elements in a way that CalculiX does not
    have.
    """
    if not text.startswith("*"):
        return False
    turned = "SYSTEM=" in "".join(text.upper().split())
    if _keyword_of(text) in ("SYSTEM", *_GENERATION):
        return True
    return _keyword_of(text) == "NODE" and turned


def _is_mass_element(text: str) -> bool:
    """Whether a line is *ELEMENT of point masses."""
    options = "".join(text.upper().split()).split(",")
    types = {f"TYPE={name}" for name in POINTS}
    return options[0] == "*ELEMENT" and not types.isdisjoint(options)


def _keyword_of(text: str) -> str:
    return "".join(text[1:].split(",")[0].upper().split())


def _shorten_line(text: str) -> str:
    """Return a data line with shortened numbers: CalculiX truncates long ones."""
    words = text.split(",")
    if all(len(word.strip()) <= _MAX_NUMBER_LENGTH for word in words):
        return text
    return ",".join(_shorten_number(word.strip()) for word in words)


def _shorten_number(word: str) -> str:
    try:
        return word if len(word) <= _MAX_NUMBER_LENGTH else f"{float(word):.12e}"
    except ValueError:
        return word


def with_density(lines: list[str], density: float) -> list[str]:
    """The deck with a density for materials that have none."""
    result: list[str] = []
    lacks_density = False
    for text in [*lines, "*"]:
        keyword = _keyword_of(text) if text.startswith("*") else ""
        if keyword == "DENSITY":
            lacks_density = False
        if lacks_density and (text == "*" or keyword in _AFTER_MATERIALS):
            result += ["*DENSITY", f"{density!r}"]
            lacks_density = False
        if keyword == "MATERIAL":
            lacks_density = True
        result.append(text)
    return result[:-1]


def centre_nodes(lines: list[str]) -> tuple[list[str], Array]:
    """Return the deck with its nodes relative to their centre, and the centre (3,).

    CalculiX writes positions to six digits, which are more exact for small bodies
    there.
    """
    rows = [i for i, line in _data_lines(lines, "NODE")]
    table = np.zeros((len(rows), 3))
    for k, i in enumerate(rows):
        label, *words = (word.strip() for word in lines[i].split(","))
        given = [word or "0" for word in words[:3]]
        table[k, : len(given)] = parse_numbers(given, f"node {label}", "coordinates")
    centre = table.mean(axis=0) if rows else np.zeros(3)
    result = list(lines)
    for i, place in zip(rows, (table - centre).tolist(), strict=True):
        label = lines[i].split(",")[0]
        result[i] = ", ".join([label, *(f"{x:.12e}" for x in place)])
    return result, centre


def _data_lines(lines: list[str], keyword: str) -> Iterator[tuple[int, str]]:
    """The data lines of a keyword, and which lines they are."""
    inside = False
    for i, text in enumerate(lines):
        if text.startswith("*"):
            inside = _keyword_of(text) == keyword
        elif inside:
            yield i, text


def without_layers(lines: list[str]) -> list[str]:
    """Return the deck with the layers of composite shells merged to one. CalculiX
    writes the mesh of the layers of composites; the mesh of one layer has the nodes of
    the matrices.
    """
    result: list[str] = []
    layers: list[list[str]] = []
    for text in [*lines, "*"]:
        if layers and not text.startswith("*"):
            layers.append(text.split(","))
            continue
        if layers:
            head, *rows = layers
            thickness = sum(float(row[0]) for row in rows)
            result += [
                f"{','.join(head)},MATERIAL={rows[0][2].strip()}",
                f"{thickness!r}",
            ]
            layers = []
        options = [word.strip() for word in text.split(",")]
        upper = [word.upper() for word in options]
        if "".join(upper[0].split()) == "*SHELLSECTION" and "COMPOSITE" in upper:
            other_options = [
                w for w, u in zip(options, upper, strict=True) if u != "COMPOSITE"
            ]
            layers = [
                [w for w in other_options if not w.upper().startswith("ORIENTATION")]
            ]
        else:
            result.append(text)
    return result[:-1]


def _deck_lines(path: Path, included: IncludedFiles) -> Iterator[tuple[str, str]]:
    included.enter(path)
    for number, line in enumerate(read_lines(path), start=1):
        text, place = line.strip(), f"line {number}"
        word, _, rest = text.partition(",")
        if "".join(word.upper().split()) == "*INCLUDE":
            yield from _deck_lines(
                named_file(path, _included_file(rest, place)), included
            )
        elif _names_data(word) and "INPUT=" in "".join(rest.upper().split()):
            options = rest.split(",")
            own = [x for x in options if not x.strip().upper().startswith("INPUT")]
            yield ",".join([word, *own]), place
            yield from _deck_lines(
                named_file(path, _included_file(rest, place)), included
            )
        elif text:
            yield text, place
    included.open.pop()


def _names_data(word: str) -> bool:
    """Whether the file that a keyword names continues the deck."""
    return word.startswith("*") and _keyword_of(word) in ("NODE", "ELEMENT")


def _included_file(options: str, place: str) -> str:
    for option in options.split(","):
        name, _, value = option.partition("=")
        if name.strip().upper() == "INPUT" and value.strip():
            return value.strip().strip('"')
    raise InputError("names no file", place=place, expected="INPUT=FILE")
