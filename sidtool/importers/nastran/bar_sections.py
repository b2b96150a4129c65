"""PBAR, PBARL, PBEAM, PBEAML and PROD of Nastran bulk data."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sidtool.formats.base.errors import InputError

from ...mesh.connections import BarSection, SectionProfile
from .cards import Card
from .content import BarProperty, BulkData, duplicate_error

#: Ratio of shear area to area for rigid shear (K = 0).
_RIGID_SHEAR_RATIO = 1e6
#: Type of section -> number of its dimensions.
_DIMENSION_COUNTS = {
    "ROD": 1,
    "TUBE": 2,
    "TUBE2": 2,
    "BAR": 2,
    "BOX": 4,
    "BOX1": 6,
    "I": 6,
    "I1": 4,
    "H": 4,
    "CROSS": 4,
    "T": 4,
    "T1": 4,
    "T2": 4,
    "CHAN": 4,
    "CHAN1": 4,
    "CHAN2": 4,
    "HAT": 4,
}
#: Shear area of a circle, as a share of its area.
_CIRCLE_SHEAR = 0.9
#: Types whose shear centre is not the centroid; CBAR assumes that they coincide.
_ECCENTRIC_TYPES = ("T", "T1", "T2", "CHAN", "CHAN1", "CHAN2", "HAT", "BOX1")
#: Types whose orientation is not defined in words; PBAR describes them by I12.
_ASYMMETRIC_TYPES = ("L", "Z")
#: Product of inertia of a share below this of the moments is rounding.
_PRODUCT_TOLERANCE = 1e-12
_STATIONS = ("YES", "YESA", "NO")
#: Fields of a station of PBEAM after its position.
_FIELDS = ("area", "iz", "iy", "product", "torsion", "extra")


@dataclass(frozen=True)
class SectionProperties:
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
    constant, twist, more = map(_constant_profile, (area, torsion, extra))
    _store_section(content, card, BarSection(constant, torsion=twist, extra=more))


def pbar(content: BulkData, card: Card) -> None:
    """PID, MID, A, I1, I2, J, NSM, blank, C1 to F2, K1, K2, I12."""
    _check_blank(card, (7,), "a number behind NSM")
    values = [card.real(i, "a number") for i in range(2, 7)]
    area, i1, i2, torsion, extra = values
    product = card.real(18, "a product of inertia")
    _stress_points(content, card, 8)
    shear = (_shear_factor(card, 16, 0.0), _shear_factor(card, 17, 0.0))
    _check_end_station(card, 19)
    turn, i1, i2 = _principal(card, i1, i2, product)
    if turn and shear != (_RIGID_SHEAR_RATIO, _RIGID_SHEAR_RATIO):
        content.unread_keywords["K1 and K2 of PBAR with I12 (Nastran ignores them)"] = (
            None
        )
        shear = (_RIGID_SHEAR_RATIO, _RIGID_SHEAR_RATIO)
    first, second, third, fourth, fifth = map(
        _constant_profile, (area, i2, i1, torsion, extra)
    )
    section = BarSection(first, second, third, fourth, fifth, shear, turn)
    _store_section(content, card, section)


def pbarl(content: BulkData, card: Card) -> None:
    """PID, MID, GROUP, TYPE, ..., DIM1, DIM2, ..., NSM."""
    kind, count = _section_type(card)
    sections = [(0.0, *_section_at(card, kind, 8, count))]
    _check_end_station(card, 9 + count)
    _store_section(content, card, _bar_section_of_shapes(sections))


def pbeaml(content: BulkData, card: Card) -> None:
    """PID, MID, GROUP, TYPE, ..., DIM1, ..., NSM, then SO, X/XB, DIM1, ..., NSM."""
    kind, count = _section_type(card)
    sections = [(0.0, *_section_at(card, kind, 8, count))]
    at, last = 9 + count, sections[0]
    while card.word(at):
        _check_output(card, at)
        place = card.real(at + 1, "a place", 1.0)
        given = any(card.words[at + 2 : at + 3 + count])
        section = _section_at(card, kind, at + 2, count) if given else last[1:]
        sections.append((place, *section))
        at += 3 + count
    _check_end_station(card, at)
    _store_section(content, card, _bar_section_of_shapes(sections))


def pbeam(content: BulkData, card: Card) -> None:
    """PID, MID, A, I1, I2, I12, J, NSM at A, C1 to F2, stations, K1, K2, S1, S2, ..."""
    profiles = {name: [(0.0, card.real(2 + k, name))] for k, name in enumerate(_FIELDS)}
    at = 8
    if card.word(at).upper() not in _STATIONS:
        _stress_points(content, card, at)
        at += 8
    while card.word(at).upper() in _STATIONS:
        place = card.real(at + 1, "a place", 1.0)
        for k, name in enumerate(_FIELDS, at + 2):
            if card.word(k):
                profiles[name].append((place, card.real(k, name)))
        if card.word(at).upper() == "YES":
            _stress_points(content, card, at + 8)
            at += 8
        at += 8
    _check_blank(card, range(at + 2, at + 16), "S1, S2, NSI, CW, M1, M2, N1 or N2")
    _check_end_station(card, at + 16)
    shear = (_shear_factor(card, at, 1.0), _shear_factor(card, at + 1, 1.0))
    product = profiles.pop("product")
    turn = 0.0
    if any(value for _, value in product):
        if any(len(c) > 1 for c in (product, profiles["iz"], profiles["iy"])):
            raise _unsupported_section(card, "I12 and stations")
        i1, i2 = (profiles[name][0][1] for name in ("iz", "iy"))
        turn, i1, i2 = _principal(card, i1, i2, product[0][1])
        profiles |= {"iz": [(0.0, i1)], "iy": [(0.0, i2)]}
        if shear[0] != shear[1]:
            raise _unsupported_section(card, "I12, and K1 other than K2")
    area, iz, iy, torsion, extra = (tuple(sorted(c)) for c in profiles.values())
    _store_section(content, card, BarSection(area, iy, iz, torsion, extra, shear, turn))


def _principal(
    card: Card, i1: float, i2: float, product: float
) -> tuple[float, float, float]:
    """Return the angle of the principal axes from y towards z, and their moments.

    With I1 the integral of y^2, I2 of z^2 and I12 of y z, about z and y,
    tan 2 t = 2 I12 / (I1 - I2).

    Raises
    ------
    InputError : no section has such moments.
    """
    if not product:
        return 0.0, i1, i2
    turn = math.atan2(2 * product, i1 - i2) / 2
    mean, radius = (i1 + i2) / 2, math.hypot((i1 - i2) / 2, product)
    least = mean - radius
    if least < -_PRODUCT_TOLERANCE * mean or mean <= 0:
        raise InputError(
            f"{card.name} {card.word(0)} has I1 {i1:g}, I2 {i2:g} and I12 {product:g}",
            place=card.place,
            expected="I12 squared below I1 times I2",
        )
    return turn, mean + radius, least if least > _PRODUCT_TOLERANCE * mean else 0.0


def _bar_section_of_shapes(
    sections: Sequence[tuple[float, SectionProperties, float]],
) -> BarSection:
    def profile(name: str) -> SectionProfile:
        return tuple(sorted((at, getattr(s, name)) for at, s, _ in sections))

    return BarSection(
        profile("area"),
        profile("iy"),
        profile("iz"),
        profile("torsion"),
        tuple(sorted((at, extra) for at, _, extra in sections)),
        sections[0][1].shear,
    )


def _section_type(card: Card) -> tuple[str, int]:
    kind = card.word(3).upper()
    if kind in _ECCENTRIC_TYPES and card.name == "PBEAML":
        raise _unsupported_section(
            card, f"a {kind}, whose centroid is not its shear centre"
        )
    if kind in _ASYMMETRIC_TYPES:
        raise InputError(
            f"{card.name} {card.word(0)} is a {kind}, whose product of inertia has a "
            "sign that only its figure shows",
            place=card.place,
            expected="PBAR with I12",
        )
    if kind not in _DIMENSION_COUNTS:
        raise InputError(
            f"{card.name} {card.word(0)} is a {kind or 'section without a type'}",
            place=card.place,
            expected=f"{', '.join(_DIMENSION_COUNTS)}, or PBAR and PBEAM with its "
            "properties",
        )
    return kind, _DIMENSION_COUNTS[kind]


def _section_at(
    card: Card, kind: str, at: int, count: int
) -> tuple[SectionProperties, float]:
    for i in range(count):
        if not card.word(at + i):
            raise InputError(
                f"{card.name} {card.word(0)} leaves DIM{i + 1} of its {kind} blank",
                place=card.place,
                expected=f"{count} dimensions",
            )
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


def section_of(kind: str, sizes: Sequence[float]) -> SectionProperties:
    """The section of a type.

    BAR: width along z, height along y; BOX: the same, thickness of the walls along z
    and of those along y. Torsion of a bar by Roark (table 10.1), of a box by Bredt.
    The shear area of a circle is 0.9 of its area, as Nastran has it; those of tubes are
    of G. R. Cowper (J. Appl. Mech. 33, 1966) for nu = 0; of a box its webs.
    """
    if kind in ("ROD", "TUBE", "TUBE2"):
        outer = sizes[0]
        inner = {"ROD": 0.0, "TUBE": sizes[-1], "TUBE2": outer - sizes[-1]}[kind]
        if not 0 <= inner < outer:
            raise ValueError(sizes)
        i = math.pi / 4 * (outer**4 - inner**4)
        m = (inner / outer) ** 2
        share = 6 * (1 + m) ** 2 / (7 + 34 * m + 7 * m**2) if m else _CIRCLE_SHEAR
        area = math.pi * (outer**2 - inner**2)
        return SectionProperties(area, i, i, 2 * i, (share, share))
    if kind in _PLATES:
        return _section_of_plates(kind, sizes)
    w, h = sizes[:2]
    if kind == "BAR":
        a, b = max(w, h), min(w, h)
        torsion = a * b**3 * (1 / 3 - 0.21 * b / a * (1 - (b / a) ** 4 / 12))
        iy, iz = h * w**3 / 12, w * h**3 / 12
        return SectionProperties(w * h, iy, iz, torsion, (5 / 6, 5 / 6))
    t1, t2 = sizes[2:]
    wide, high = w - 2 * t2, h - 2 * t1
    if min(wide, high, t1, t2) < 0:
        raise ValueError(sizes)
    area = w * h - wide * high
    iy, iz = (h * w**3 - high * wide**3) / 12, (w * h**3 - wide * high**3) / 12
    torsion = 2 * t1 * t2 * (w - t2) ** 2 * (h - t1) ** 2
    torsion /= w * t2 + h * t1 - t2**2 - t1**2
    return SectionProperties(
        area, iy, iz, torsion, (2 * h * t2 / area, 2 * w * t1 / area)
    )


#: Rectangles of a section of plates: width along z, height along y, and the y and z of
#: their centres. Sizes are those of Nastran (PBARL).
_Plates = list[tuple[float, float, float, float]]


def _flanged_plates(
    height: float, bottom: float, top: float, web: float, low: float, high: float
) -> _Plates:
    """A web between a flange below and one above."""
    return [
        (bottom, low, low / 2, 0.0),
        (web, height - low - high, low + (height - low - high) / 2, 0.0),
        (top, high, height - high / 2, 0.0),
    ]


def _channel_plates(width: float, height: float, web: float, flange: float) -> _Plates:
    """A web with two flanges to one side."""
    inner = width - web
    return [
        (web, height, 0.0, web / 2),
        (inner, flange, (height - flange) / 2, web + inner / 2),
        (inner, flange, (flange - height) / 2, web + inner / 2),
    ]


_PLATES: dict[str, Callable[..., _Plates]] = {
    "I": lambda h, b, t, w, low, high: _flanged_plates(h, b, t, w, low, high),
    "I1": lambda a, w, inner, h: _flanged_plates(
        h, a + w, a + w, w, (h - inner) / 2, (h - inner) / 2
    ),
    "H": lambda inner, both, h, web: [
        (both / 2, h, 0.0, (inner + both / 2) / 2),
        (both / 2, h, 0.0, -(inner + both / 2) / 2),
        (inner, web, 0.0, 0.0),
    ],
    "CROSS": lambda arms, web, h, t: [
        (web, h, 0.0, 0.0),
        (arms / 2, t, 0.0, (arms / 2 + web) / 2),
        (arms / 2, t, 0.0, -(arms / 2 + web) / 2),
    ],
    "T": lambda b, h, flange, web: [
        (b, flange, h - flange / 2, 0.0),
        (web, h - flange, (h - flange) / 2, 0.0),
    ],
    "T1": lambda b, stem, flange, web: [
        (flange, b, 0.0, 0.0),
        (stem, web, 0.0, (flange + stem) / 2),
    ],
    "T2": lambda b, h, flange, web: [
        (b, flange, flange / 2, 0.0),
        (web, h - flange, flange + (h - flange) / 2, 0.0),
    ],
    "CHAN": _channel_plates,
    "CHAN1": lambda a, web, inner, h: _channel_plates(a + web, h, web, (h - inner) / 2),
    "CHAN2": lambda leg, base, h, b: [
        (b, base, base / 2, 0.0),
        (leg, h - base, base + (h - base) / 2, (b - leg) / 2),
        (leg, h - base, base + (h - base) / 2, (leg - b) / 2),
    ],
    "HAT": lambda h, t, b, flange: [
        (b, t, h - t / 2, 0.0),
        (t, h - 2 * t, h / 2, (b - t) / 2),
        (t, h - 2 * t, h / 2, (t - b) / 2),
        (flange + t, t, t / 2, (b + flange - t) / 2),
        (flange + t, t, t / 2, (t - b - flange) / 2),
    ],
    "BOX1": lambda b, h, top, low, right, left: [
        (b, top, h - top / 2, 0.0),
        (b, low, low / 2, 0.0),
        (right, h - top - low, low + (h - top - low) / 2, (right - b) / 2),
        (left, h - top - low, low + (h - top - low) / 2, (b - left) / 2),
    ],
}


def _section_of_plates(kind: str, sizes: Sequence[float]) -> SectionProperties:
    """The section of plates, whose parts do not overlap.

    Moments by Steiner; torsion of an open one as the sum of b t^3 / 3 (Timoshenko,
    Strength of Materials II, 1956, section 53), of BOX1 by Bredt; shear areas are those
    of the plates along y and z, as Roark has them for I sections.
    """
    plates = _PLATES[kind](*sizes)
    if min(min(w, h) for w, h, _, _ in plates) <= 0:
        raise ValueError(sizes)
    area = sum(w * h for w, h, _, _ in plates)
    y0 = sum(w * h * y for w, h, y, _ in plates) / area
    z0 = sum(w * h * z for w, h, _, z in plates) / area
    iz = sum(w * h * (h**2 / 12 + (y - y0) ** 2) for w, h, y, _ in plates)
    iy = sum(w * h * (w**2 / 12 + (z - z0) ** 2) for w, h, _, z in plates)
    torsion = sum(max(w, h) * min(w, h) ** 3 / 3 for w, h, _, _ in plates)
    if kind == "BOX1":
        b, h, top, low, right, left = sizes
        wide, high = b - (right + left) / 2, h - (top + low) / 2
        around = wide / top + wide / low + high / right + high / left
        torsion = 4 * (wide * high) ** 2 / around
    upright = sum(w * h for w, h, _, _ in plates if h >= w)
    flat = area - upright
    return SectionProperties(
        area, iy, iz, torsion, (upright / area or 1.0, flat / area or 1.0)
    )


def _constant_profile(value: float) -> SectionProfile:
    return ((0.0, value),)


def _shear_factor(card: Card, at: int, default: float) -> float:
    return card.real(at, "a shear factor", default) or _RIGID_SHEAR_RATIO


def _stress_points(content: BulkData, card: Card, at: int, count: int = 8) -> None:
    if any(card.words[at : at + count]):
        content.unread_keywords[f"stress points of {card.name}"] = None


def _check_output(card: Card, at: int) -> None:
    if card.word(at).upper() not in _STATIONS:
        raise InputError(
            f"{card.name} {card.word(0)} holds {card.word(at)!r}",
            place=card.place,
            expected=" or ".join(_STATIONS),
        )


def _check_blank(card: Card, places: Sequence[int], what: str) -> None:
    if any(card.real(i, "a number") for i in places):
        raise _unsupported_section(card, what)


def _unsupported_section(card: Card, what: str) -> InputError:
    return InputError(
        f"{card.name} {card.word(0)} holds {what}",
        place=card.place,
        expected="principal axes, one axis of centroids and shear centres, no warping",
    )


def _check_end_station(card: Card, at: int) -> None:
    if any(card.words[at:]):
        raise InputError(
            f"{card.name} {card.word(0)} holds {' '.join(card.words[at:]).strip()}",
            place=card.place,
            expected=f"{at} fields",
        )


def _store_section(content: BulkData, card: Card, section: BarSection) -> None:
    label = card.integer(0, "a property")
    if label in content.bar_properties or label in content.properties:
        raise duplicate_error("property", label, card)
    material = str(card.integer(1, "a material"))
    content.bar_properties[label] = BarProperty(material, section, card.place)
