"""PBAR, PBARL, PBEAM, PBEAML and PROD of Nastran bulk data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sidtool.formats.errors import InputError

from ..imported_bars import BarSection, Course
from .cards import Card
from .content import BarProperty, BulkData, twice

#: A shear area so large beside the area that it deforms nothing: where K is zero.
_RIGID = 1e6
#: Type of section -> number of its dimensions.
_COUNTS = {"ROD": 1, "TUBE": 2, "TUBE2": 2, "BAR": 2, "BOX": 4}
_STATIONS = ("YES", "YESA", "NO")
#: Fields of a station of PBEAM behind its place.
_FIELDS = ("area", "iz", "iy", "product", "torsion", "extra")


@dataclass(frozen=True)
class Shape:
    """A section: area, second moments about y and z, torsion constant, shear areas."""

    area: float
    iy: float
    iz: float
    torsion: float
    shear: tuple[float, float]


def prod(content: BulkData, card: Card) -> None:
    """PID, MID, A, J, C, NSM."""
    area, torsion = card.real(2, "an area"), card.real(3, "a torsion constant")
    extra = card.real(5, "a mass per length")
    _stress_points(content, card, 4, 1)
    constant, twist, more = map(_constant, (area, torsion, extra))
    _kept(content, card, BarSection(constant, torsion=twist, extra=more))


def pbar(content: BulkData, card: Card) -> None:
    """PID, MID, A, I1, I2, J, NSM, blank, C1 to F2, K1, K2, I12."""
    _zero(card, (7, 18), "I12")
    area, iz, iy, torsion, extra = (
        _constant(card.real(i, "a number")) for i in range(2, 7)
    )
    _stress_points(content, card, 8)
    shear = (_shear(card, 16, 0.0), _shear(card, 17, 0.0))
    _ends_at(card, 19)
    _kept(content, card, BarSection(area, iy, iz, torsion, extra, shear))


def pbarl(content: BulkData, card: Card) -> None:
    """PID, MID, GROUP, TYPE, ..., DIM1, DIM2, ..., NSM."""
    kind, count = _kind(card)
    sections = [(0.0, *_section(card, kind, 8, count))]
    _ends_at(card, 9 + count)
    _kept(content, card, _of_shapes(sections))


def pbeaml(content: BulkData, card: Card) -> None:
    """PID, MID, GROUP, TYPE, ..., DIM1, ..., NSM, then SO, X/XB, DIM1, ..., NSM."""
    kind, count = _kind(card)
    sections = [(0.0, *_section(card, kind, 8, count))]
    at, last = 9 + count, sections[0]
    while card.word(at):
        _check_output(card, at)
        place = card.real(at + 1, "a place", 1.0)
        given = any(card.words[at + 2 : at + 3 + count])
        found = _section(card, kind, at + 2, count) if given else last[1:]
        sections.append((place, *found))
        at += 3 + count
    _ends_at(card, at)
    _kept(content, card, _of_shapes(sections))


def pbeam(content: BulkData, card: Card) -> None:
    """PID, MID, A, I1, I2, I12, J, NSM at A, C1 to F2, stations, K1, K2, S1, S2, ..."""
    courses = {name: [(0.0, card.real(2 + k, name))] for k, name in enumerate(_FIELDS)}
    at = 8
    if card.word(at).upper() not in _STATIONS:
        _stress_points(content, card, at)
        at += 8
    while card.word(at).upper() in _STATIONS:
        place = card.real(at + 1, "a place", 1.0)
        for k, name in enumerate(_FIELDS, at + 2):
            if card.word(k):
                courses[name].append((place, card.real(k, name)))
        if card.word(at).upper() == "YES":
            _stress_points(content, card, at + 8)
            at += 8
        at += 8
    _zero(card, range(at + 2, at + 16), "S1, S2, NSI, CW, M1, M2, N1 or N2")
    _ends_at(card, at + 16)
    if any(value for _, value in courses.pop("product")):
        raise _refused(card, "I12")
    shear = (_shear(card, at, 1.0), _shear(card, at + 1, 1.0))
    area, iz, iy, torsion, extra = (tuple(sorted(c)) for c in courses.values())
    _kept(content, card, BarSection(area, iy, iz, torsion, extra, shear))


def _of_shapes(sections: Sequence[tuple[float, Shape, float]]) -> BarSection:
    def course(name: str) -> Course:
        return tuple(sorted((at, getattr(s, name)) for at, s, _ in sections))

    return BarSection(
        course("area"),
        course("iy"),
        course("iz"),
        course("torsion"),
        tuple(sorted((at, extra) for at, _, extra in sections)),
        sections[0][1].shear,
    )


def _kind(card: Card) -> tuple[str, int]:
    kind = card.word(3).upper()
    if kind not in _COUNTS:
        raise InputError(
            f"{card.name} {card.word(0)} is a {kind or 'section without a type'}",
            place=card.place,
            expected=f"{', '.join(_COUNTS)}, or PBAR and PBEAM with its properties",
        )
    return kind, _COUNTS[kind]


def _section(card: Card, kind: str, at: int, count: int) -> tuple[Shape, float]:
    sizes = [card.real(at + i, "a dimension") for i in range(count)]
    try:
        shape = section_of(kind, sizes)
    except (ValueError, ZeroDivisionError):
        shape = None
    if shape is None or min(sizes[0], shape.area, shape.iy, shape.iz) <= 0:
        raise InputError(
            f"{card.name} {card.word(0)} is no {kind}: {sizes}",
            place=card.place,
            expected="dimensions of a section",
        )
    return shape, card.real(at + count, "a mass per length")


def section_of(kind: str, sizes: Sequence[float]) -> Shape:
    """The section of a type.

    BAR: width along z, height along y; BOX: the same, thickness of the walls along z
    and of those along y. Torsion of a bar by Roark (table 10.1), of a box by Bredt.
    Shear areas of circles and tubes are those of G. R. Cowper (J. Appl. Mech. 33,
    1966) for nu = 0, from which those of Nastran differ by 2e-3; of a box its webs.
    """
    if kind in ("ROD", "TUBE", "TUBE2"):
        outer = sizes[0]
        inner = {"ROD": 0.0, "TUBE": sizes[-1], "TUBE2": outer - sizes[-1]}[kind]
        if not 0 <= inner < outer:
            raise ValueError(sizes)
        i = math.pi / 4 * (outer**4 - inner**4)
        m = (inner / outer) ** 2
        share = 6 * (1 + m) ** 2 / (7 + 34 * m + 7 * m**2)
        area = math.pi * (outer**2 - inner**2)
        return Shape(area, i, i, 2 * i, (share, share))
    w, h = sizes[:2]
    if kind == "BAR":
        a, b = max(w, h), min(w, h)
        torsion = a * b**3 * (1 / 3 - 0.21 * b / a * (1 - (b / a) ** 4 / 12))
        iy, iz = h * w**3 / 12, w * h**3 / 12
        return Shape(w * h, iy, iz, torsion, (5 / 6, 5 / 6))
    t1, t2 = sizes[2:]
    wide, high = w - 2 * t2, h - 2 * t1
    if min(wide, high, t1, t2) < 0:
        raise ValueError(sizes)
    area = w * h - wide * high
    iy, iz = (h * w**3 - high * wide**3) / 12, (w * h**3 - wide * high**3) / 12
    torsion = 2 * t1 * t2 * (w - t2) ** 2 * (h - t1) ** 2
    torsion /= w * t2 + h * t1 - t2**2 - t1**2
    return Shape(area, iy, iz, torsion, (2 * h * t2 / area, 2 * w * t1 / area))


def _constant(value: float) -> Course:
    return ((0.0, value),)


def _shear(card: Card, at: int, default: float) -> float:
    return card.real(at, "a shear factor", default) or _RIGID


def _stress_points(content: BulkData, card: Card, at: int, count: int = 8) -> None:
    if any(card.words[at : at + count]):
        content.said[f"stress points of {card.name}"] = None


def _check_output(card: Card, at: int) -> None:
    if card.word(at).upper() not in _STATIONS:
        raise InputError(
            f"{card.name} {card.word(0)} holds {card.word(at)!r}",
            place=card.place,
            expected=" or ".join(_STATIONS),
        )


def _zero(card: Card, places: Sequence[int], what: str) -> None:
    if any(card.real(i, "a number") for i in places):
        raise _refused(card, what)


def _refused(card: Card, what: str) -> InputError:
    return InputError(
        f"{card.name} {card.word(0)} holds {what}",
        place=card.place,
        expected="principal axes, one axis of centroids and shear centres, no warping",
    )


def _ends_at(card: Card, at: int) -> None:
    if any(card.words[at:]):
        raise InputError(
            f"{card.name} {card.word(0)} holds {' '.join(card.words[at:]).strip()}",
            place=card.place,
            expected=f"{at} fields",
        )


def _kept(content: BulkData, card: Card, section: BarSection) -> None:
    label = card.integer(0, "a property")
    if label in content.bar_properties or label in content.properties:
        raise twice("property", label, card)
    material = str(card.integer(1, "a material"))
    content.bar_properties[label] = BarProperty(material, section, card.place)
