"""Contents of an ANSYS archive, its coordinate systems, and materials (MP, MPDATA)."""

from dataclasses import dataclass, field

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import Material

from ...mesh.deck_text import RefusalCollector, parse_integers, parse_numbers
from ...mesh.materials import (
    AnisotropicMaterial,
    CylindricalMaterial,
    ElasticMaterial,
    orthotropic_law,
)


@dataclass(frozen=True)
class LocalSystem:
    """A system of LOCAL.

    Attributes
    ----------
    kind : 0 Cartesian, 1 cylindrical, 2 spherical, 3 toroidal
    origin, angles : in the global system; about z, x and y in turn [degrees]
    """

    kind: int
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    angles: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass
class ConstraintEquation:
    """A CE: nodes, labels of directions and factors."""

    place: str
    terms: list[tuple[int, str, float]] = field(default_factory=list)


@dataclass
class ArchiveContent:
    """The lines of an archive, and their content.

    Attributes
    ----------
    density : of materials without DENS
    turned : node -> angles of its directions, if they are not zero
    systems : of LOCAL
    stops : reasons to refuse the file
    sums, coupled, reals : CE, CP by number and direction, and R
    """

    lines: list[str]
    at: int = 0
    density: float | None = None
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    types: dict[int, int] = field(default_factory=dict)
    options: dict[tuple[int, int], int] = field(default_factory=dict)
    elements: list[tuple[list[int], str]] = field(default_factory=list)
    constants: dict[int, dict[str, float]] = field(default_factory=dict)
    tables: dict[tuple[int, str], list[float]] = field(default_factory=dict)
    sets: dict[str, list[int]] = field(default_factory=dict)
    parts: dict[str, list[int]] = field(default_factory=dict)
    current: dict[str, int] = field(default_factory=dict)
    unread_keywords: dict[str, None] = field(default_factory=dict)
    branches: int = 0
    turned: dict[int, tuple[float, ...]] = field(default_factory=dict)
    systems: dict[int, LocalSystem] = field(default_factory=dict)
    sums: dict[int, ConstraintEquation] = field(default_factory=dict)
    coupled: dict[tuple[str, str], tuple[str, list[int]]] = field(default_factory=dict)
    reals: dict[int, list[float]] = field(default_factory=dict)
    stops: RefusalCollector = field(default_factory=RefusalCollector)

    @property
    def place(self) -> str:
        """Location of the current line."""
        return f"line {self.at}"

    def next(self) -> str:
        """The next line.

        Raises
        ------
        InputError : the file ends.
        """
        if self.at >= len(self.lines):
            raise InputError("ends inside a block", expected="the rest of the block")
        self.at += 1
        return self.lines[self.at - 1]


def axes_of(angles: tuple[float, ...]) -> Array:
    """(3, 3) whose rows are the axes of a system that is turned by THXY, THYZ, THZX."""
    (c, cx, cy), (s, sx, sy) = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.asarray((about_z @ about_x @ about_y).T, float)


def read_local(content: ArchiveContent, words: list[str]) -> None:
    """LOCAL, number, kind, origin, angles, or these behind LOC and ANG of R5.0.

    It becomes the system that further nodes are given in.
    """
    part = "".join(words[2:3]).upper() if words[1].upper().startswith("R5") else ""
    begin = 3 if part else 1
    label, kind = parse_integers(
        [word or "0" for word in [*words[begin:], ""][:2]], content.place, "a system"
    )
    rest = [word or "0" for word in [*words[begin + 2 :], *[""] * 6][:6]]
    values = tuple(parse_numbers(rest, content.place))
    known = content.systems.get(label, LocalSystem(kind))
    if part == "ANG":
        content.systems[label] = LocalSystem(kind, known.origin, values[:3])
    elif part == "LOC":
        content.systems[label] = LocalSystem(kind, values[:3], known.angles)
    elif not part:
        content.systems[label] = LocalSystem(kind, values[:3], values[3:])
    elif values[:2] not in ((0.0, 0.0), (1.0, 1.0)) or any(values[2:]):
        raise InputError(
            f"LOCAL {label} has parameters",
            place=content.place,
            expected="a circular system",
        )
    content.current["CSYS"] = label


def system_of(content: ArchiveContent, label: int, place: str) -> LocalSystem:
    """Return a system of the file, or a predefined one of ANSYS.

    Raises
    ------
    InputError : it is not defined, or neither Cartesian nor cylindrical.
    """
    system = content.systems.get(label, LocalSystem(label) if label in (0, 1) else None)
    if system is None or system.kind not in (0, 1):
        what = "is not defined" if system is None else f"is of kind {system.kind}"
        raise InputError(
            f"the system {label} {what}",
            place=place,
            expected="a Cartesian or cylindrical system of LOCAL",
        )
    return system


_MODULI, _SHEARS = ("EX", "EY", "EZ"), ("GXY", "GXZ", "GYZ")
#: The first and second axis of each ratio.
_PAIRS = {"XY": (0, 1), "XZ": (0, 2), "YZ": (1, 2)}
_RATIOS = tuple(f"{kind}{pair}" for kind in ("PR", "NU") for pair in _PAIRS)
_CONSTANTS = (*_MODULI, *_SHEARS, *_RATIOS, "DENS")
#: Place of the system of an element among its numbers.
_ESYS = 4
#: GXY of an isotropic material may be rounded by this share.
_ROUNDED = 1e-3
#: Properties that a linear elastic body does not need.
_OTHER_CONSTANTS = (
    *("ALPX", "ALPY", "ALPZ", "CTEX", "CTEY", "CTEZ", "REFT", "KXX", "KYY", "KZZ"),
    *("THSX", "THSY", "THSZ", "C", "ENTH", "EMIS", "HF", "VISC", "SONC", "QRATE"),
    *("RSVX", "RSVY", "RSVZ", "MURX", "MURY", "MURZ", "PERX", "PERY", "PERZ"),
    *("MU", "DMPR", "DAMP", "ALPD", "BETD"),
)
#: Tables of TB about behaviour beyond the elastic limit, surfaces or time.
_BEYOND_ELASTIC = """
    BISO MISO NLISO BKIN MKIN KINH CHABOCHE PLASTIC CREEP HILL RATE FRIC SDAMP AVALUE
    FATIGUE FCLI CTE THERM SPHT
"""


def read_property(content: ArchiveContent, words: list[str]) -> None:
    """MP, name, material, value, or MPDATA, R5.0, n, name, material, start, values.

    The values of MPDATA at further temperatures follow in lines of their own.

    Raises
    ------
    InputError : a linear elastic body has no such property.
    """
    start = 1
    if words[0].upper() == "MPDATA":
        skip = 3 if words[1].upper().startswith("R5") else 1
        name, number, begin, *values = words[skip:]
        start = parse_integers([begin or "1"], content.place, "a place in the table")[0]
    else:
        name, number, *values = words[1:]
    name, given = name.upper(), [value for value in values if value]
    material = parse_integers([number], content.place, "a material")[0]
    if name not in _CONSTANTS:
        if name not in _OTHER_CONSTANTS:
            raise InputError(
                f"property {name} of material {material} is not supported",
                place=content.place,
                expected=f"one of {', '.join([*_CONSTANTS, *_OTHER_CONSTANTS])}",
            )
        content.unread_keywords[f"property {name}"] = None
        return
    numbers = parse_numbers(given, content.place, "a constant")
    table = content.tables.setdefault((material, name), [])
    if not 1 <= start <= len(table) + 1:
        raise InputError(
            f"MPDATA of {name} begins at entry {start} behind {len(table)}",
            place=content.place,
            expected="a table without gaps",
        )
    table[start - 1 :] = numbers
    constants = content.constants.setdefault(material, {})
    constants.pop(name, None)
    if len(set(table)) == 1:
        constants[name] = table[0]


def read_table(content: ArchiveContent, words: list[str]) -> None:
    """TB, kind, material, ...: without effect, unless it is the elasticity.

    Raises
    ------
    InputError : the table changes the elasticity, or is not known.
    """
    kind = "".join(words[1:2]).upper()
    if kind not in _BEYOND_ELASTIC.split():
        raise InputError(
            f"TB, {kind} is not supported",
            place=content.place,
            expected="the elasticity by MP: EX, PRXY, GXY, ...",
        )
    content.unread_keywords[f"TB, {kind}"] = None


def materials_of(content: ArchiveContent) -> dict[str, ElasticMaterial]:
    """Return the complete and constant materials.

    Raises
    ------
    InputError : orthotropic constants are not positive definite, or their elements are
    in
        a system that is neither Cartesian nor cylindrical.
    """
    materials: dict[str, ElasticMaterial] = {}
    for number, given in content.constants.items():
        table = dict(given)
        if content.density is not None and (number, "DENS") not in content.tables:
            table["DENS"] = content.density
        known = {name for own, name in content.tables if own == number}
        if known - set(table) or min(table.get(n, 0.0) for n in ("EX", "DENS")) <= 0:
            continue
        given = {name: value for name, value in given.items() if name != "DENS"}
        if _is_isotropic(given):
            nu = _poissons_ratio(given)
            if nu is not None and -1 < nu < 0.5:
                materials[str(number)] = Material(
                    youngs_modulus=table["EX"],
                    poissons_ratio=nu,
                    density=table["DENS"],
                )
            continue
        law = _orthotropic_law(number, given)
        if law is not None:
            materials[str(number)] = AnisotropicMaterial(law, table["DENS"])
    for values, place in content.elements:
        own, name = materials.get(str(values[0])), material_name(values)
        if isinstance(own, AnisotropicMaterial) and name not in materials:
            materials[name] = _orient_material(own, content, values[_ESYS], place)
    return materials


def material_name(values: list[int]) -> str:
    """Return the name of the material of an element, with its coordinate system."""
    system = f" along {values[_ESYS]}" if values[_ESYS] else ""
    return f"{values[0]}{system}"


def _poissons_ratio(given: dict[str, float]) -> float | None:
    """Poisson's ratio of EX, one ratio or a shear modulus; None if neither is given."""
    if "PRXY" in given or "NUXY" in given:
        return given.get("PRXY", given.get("NUXY"))
    return given["EX"] / (2 * given["GXY"]) - 1 if given.get("GXY") else None


def _is_isotropic(given: dict[str, float]) -> bool:
    """Whether EX, one ratio and a shear modulus of these are all that is given."""
    ratio = _poissons_ratio(given)
    if set(given) - {"EX", "PRXY", "NUXY", "GXY"}:
        return False
    if ratio is None or "GXY" not in given:
        return True
    shear = given["EX"] / (2 * (1 + ratio))
    return abs(given["GXY"] - shear) <= _ROUNDED * abs(shear)


def _orthotropic_law(number: int, given: dict[str, float]) -> np.ndarray | None:
    """Return the law of orthotropic constants, or None if some are missing.

    Constants of other axes default to those along x. PRXY is the contraction along y
    under tension along x; NUXY = PRXY EY / EX.
    """
    moduli = [given.get(name, given["EX"]) for name in _MODULI]
    ratios, shears = [], []
    for pair, (i, j) in _PAIRS.items():
        major, minor = given.get(f"PR{pair}"), given.get(f"NU{pair}")
        if major is None and minor is not None:
            major = minor * moduli[i] / moduli[j]
        ratios.append(major)
        shears.append(given.get(f"G{pair}"))
    if len(set(moduli)) == 1:
        ratios = [ratios[0] if ratio is None else ratio for ratio in ratios]
        shears = [shears[0] if shear is None else shear for shear in shears]
    values = [*moduli, *ratios, *shears]
    if None in values:
        return None
    try:
        return orthotropic_law(np.array(values, float))
    except InputError as error:
        raise InputError(
            f"material {number}: {error.problem}", expected=error.expected
        ) from None


def _orient_material(
    own: AnisotropicMaterial, content: ArchiveContent, label: int, place: str
) -> AnisotropicMaterial:
    """Along a system; of a cylindrical one along the radius, around it and along z."""
    system = system_of(content, label, place)
    axes = axes_of(system.angles)
    if system.kind == 0:
        return own.turned(axes)
    return CylindricalMaterial(own.law, own.density, np.array(system.origin), axes[2])
