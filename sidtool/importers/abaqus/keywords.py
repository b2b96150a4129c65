"""Keyword blocks of Abaqus and CalculiX input files, and the effect of each keyword.

Every keyword is read, listed as without effect, or refused by name. Unknown keywords
are refused.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from sidtool.formats.base.errors import InputError

from ...mesh.deck_text import IncludedFiles, located_line, named_file, read_lines
from ...mesh.imported_mesh import ONLY_NODES

#: Commas outside double quotes.
_COMMA = re.compile(r',(?=(?:[^"]*"[^"]*")*[^"]*$)')

#: Shortest abbreviation of a parameter.
_MIN_ABBREVIATION = 3


@dataclass(frozen=True)
class Block:
    """A keyword line with its data lines.

    Attributes
    ----------
    keyword : in capitals, words separated by one blank
    options : name in capitals -> value, "" for none
    lines : text and number of every data line, and the name of an included file
    """

    keyword: str
    options: dict[str, str]
    place: str
    lines: list[tuple[str, int, str]] = field(default_factory=list)

    @cached_property
    def rows(self) -> list[tuple[list[str], str]]:
        """The words of every data line, "" for a blank one, and where it stands."""
        return [
            (split_fields(text), located_line(number, name))
            for text, number, name in self.lines
        ]


def read_blocks(
    path: Path, included: IncludedFiles | None = None, before: list[Block] | None = None
) -> list[Block]:
    """All blocks of a file and of the files that it includes, in order.

    An included file may continue the data lines of the block that includes it.

    Parameters
    ----------
    before : blocks that were already read; those of the file are appended

    Raises
    ------
    InputError : the file is not valid; the error names file and line.
    """
    included = included or IncludedFiles()
    included.enter(path)
    blocks = [] if before is None else before
    name = path.name if len(included.open) > 1 else ""
    for is_keyword, text, number in _statements(path):
        if not is_keyword:
            if not blocks:
                raise InputError(
                    f"found {text[:40]!r} before any keyword",
                    place=located_line(number, name),
                    expected="a line like *NODE",
                )
            blocks[-1].lines.append((text, number, name))
            continue
        block = _keyword(text, located_line(number, name))
        if block.keyword == "INCLUDE":
            read_blocks(_check_names(path, block), included, blocks)
            continue
        blocks.append(block)
        # other keywords name results, as *SUBMODEL, which the body does not need
        if "INPUT" in block.options and _takes_input(block):
            file = _check_names(path, block)
            block.lines.extend(_external_data(file))
    included.open.pop()
    return blocks


def _takes_input(block: Block) -> bool:
    return "INPUT" in READ.get(_READ.get(_without_blanks(block.keyword), ""), ())


def split_fields(text: str) -> list[str]:
    """Return the words of a data line; a comma at its end does not start
    another word.
    """
    words = [word.strip() for word in text.split(",")]
    return words[:-1] if len(words) > 1 and not words[-1] else words


def _statements(path: Path) -> Iterator[tuple[bool, str, int]]:
    """Keyword lines, continuation lines joined, and data lines, with their numbers."""
    pending, begun = "", 0
    for number, line in enumerate(read_lines(path), start=1):
        text = line.strip()
        if not text or text.startswith("**"):
            continue
        starts = text[0] == "*"
        if pending and (starts or not _is_continuation(text)):
            yield True, pending, begun
            pending = ""
        if not starts and not pending:
            yield False, text, number
            continue
        begun = begun if pending else number
        pending += text
        if not text.endswith(","):
            yield True, pending, begun
            pending = ""
    if pending:
        yield True, pending, begun


def _is_continuation(text: str) -> bool:
    """Whether a line after a comma at the end of a keyword line holds parameters."""
    return text[0].isalpha() or text[0] == '"'


def _keyword(text: str, place: str) -> Block:
    words = [word.strip() for word in _COMMA.split(text[1:])]
    options = {}
    for word in words[1:]:
        name, _, value = word.partition("=")
        if name.strip():
            options[" ".join(name.upper().split())] = value.strip()
    return Block(" ".join(words[0].upper().split()), options, place)


def _check_names(path: Path, block: Block) -> Path:
    name = block.options.get("INPUT", "").strip('"')
    if not name:
        raise InputError(
            f"*{block.keyword} names no file",
            source=path,
            place=block.place,
            expected=f"*{block.keyword}, INPUT=FILE",
        )
    return named_file(path, name)


def _external_data(file: Path) -> Iterator[tuple[str, int, str]]:
    for is_keyword, text, number in _statements(file):
        if is_keyword:
            raise InputError(
                f"found {text[:40]!r}",
                place=located_line(number, file.name),
                expected="data lines only",
            )
        yield text, number, file.name


#: Keywords that are read, and the parameters that they may have.
READ: dict[str, tuple[str, ...]] = {
    "NODE": ("NSET", "SYSTEM", "INPUT"),
    "ELEMENT": ("TYPE", "ELSET", "INPUT"),
    "SYSTEM": (),
    "NGEN": ("NSET", "LINE"),
    "NFILL": ("NSET", "BIAS"),
    "NCOPY": ("OLD SET", "NEW SET", "CHANGE NUMBER", "SHIFT", "MULTIPLE"),
    "ELGEN": ("ELSET",),
    "ELCOPY": ("OLD SET", "NEW SET", "ELEMENT SHIFT", "SHIFT NODES"),
    "NSET": ("NSET", "ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"),
    "ELSET": ("ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"),
    "MATERIAL": ("NAME", "RTOL", "SRATE FACTOR", "STRAIN RATE REGULARIZATION"),
    "ELASTIC": ("TYPE", "MODULI"),
    "DENSITY": (),
    "SOLID SECTION": (
        *("ELSET", "MATERIAL", "ORIENTATION", "CONTROLS", "REF NODE", "OFFSET"),
    ),
    "SHELL SECTION": (
        *("ELSET", "MATERIAL", "OFFSET", "ORIENTATION", "COMPOSITE", "CONTROLS"),
        *("NODAL THICKNESS", "POISSON", "SECTION INTEGRATION", "STACK DIRECTION"),
    ),
    "SURFACE": (
        *("NAME", "TYPE", "INTERNAL", "COMBINE", "CROP", "TRIM", "REGION TYPE"),
        *("PROPERTY", "SCALE MASS", "DEFINITION", "FILLET RADIUS", "MAX RATIO"),
    ),
    "COUPLING": (
        *("CONSTRAINT NAME", "REF NODE", "SURFACE", "ORIENTATION"),
        *("INFLUENCE RADIUS", "ADJUST"),
    ),
    "KINEMATIC": (),
    "DISTRIBUTING": ("COUPLING", "WEIGHTING METHOD", "CYCLIC SYMMETRY"),
    "KINEMATIC COUPLING": ("REF NODE",),
    "DISTRIBUTING COUPLING": ("ELSET",),
    "RIGID BODY": (
        *("NSET", "TIE NSET", "PIN NSET", "ELSET"),
        *("REF NODE", "ROT NODE", "POSITION"),
    ),
    "MASS": ("ELSET",),
    "ROTARY INERTIA": ("ELSET",),
    "ORIENTATION": ("NAME", "SYSTEM", "DEFINITION", "LOCAL DIRECTIONS"),
    "EQUATION": (),
    "MPC": (),
    "TRANSFORM": ("NSET", "TYPE"),
    "TIE": (
        *("NAME", "POSITION TOLERANCE", "ADJUST", "TYPE", "NO ROTATION"),
        "CYCLIC SYMMETRY",
    ),
    "PART": ("NAME",),
    "END PART": (),
    "ASSEMBLY": ("NAME",),
    "END ASSEMBLY": (),
    "INSTANCE": ("NAME", "PART"),
    "END INSTANCE": (),
    "STEP": (),
    "END STEP": (),
}
#: Loads and supports, which the model file defines instead.
_SUPPORTS = """
    BOUNDARY; CLOAD; DLOAD; DSLOAD; TEMPERATURE; FILM; RADIATE; CFLUX; DFLUX; SFILM;
    INITIAL CONDITIONS; BASE MOTION; AMPLITUDE; INERTIA RELIEF; CONNECTOR MOTION;
    CONNECTOR LOAD; FIELD; SUBMODEL
"""
#: Material data that a linear elastic body does not need.
_BEYOND_ELASTIC = """
    EXPANSION; CONDUCTIVITY; SPECIFIC HEAT; PLASTIC; CREEP; VISCO; CYCLIC HARDENING;
    RATE DEPENDENT; LATENT HEAT; INELASTIC HEAT FRACTION; DEPVAR; TENSILE FAILURE;
    SHEAR FAILURE; DAMAGE INITIATION; DAMAGE EVOLUTION; ELECTRICAL CONDUCTIVITY;
    MAGNETIC PERMEABILITY; PERMEABILITY; SOLUBILITY; DIFFUSIVITY; FAIL STRESS;
    FAIL STRAIN; VISCOELASTIC; POTENTIAL; ANNEAL TEMPERATURE; DENSITY DISTRIBUTION
"""
#: Names, axes and contact properties that act through other keywords only.
_DEFINITIONS = """
    HEADING; PREPRINT; PHYSICAL CONSTANTS; SURFACE INTERACTION;
    SURFACE BEHAVIOR; FRICTION; CONTACT CONTROLS; CONTACT DAMPING; GAP CONDUCTANCE;
    SURFACE PROPERTY ASSIGNMENT; CONTACT FORMULATION; CLEARANCE;
    DISTRIBUTION; DISTRIBUTION TABLE; SECTION CONTROLS;
    HOURGLASS STIFFNESS; DESIGN VARIABLES; TIME POINTS; BASELINE CORRECTION
"""
#: Analysis and output requests, also outside steps.
_OUTPUT = """
    RESTART; NODE PRINT; EL PRINT; NODE FILE; EL FILE; CONTACT PRINT; CONTACT FILE;
    SECTION PRINT; OUTPUT; NODE OUTPUT; ELEMENT OUTPUT; ENERGY OUTPUT; ENERGY PRINT;
    CONTACT OUTPUT; MONITOR; FILE FORMAT; FILE OUTPUT; STATIC; FREQUENCY; DYNAMIC;
    BUCKLE; MODAL DYNAMIC; STEADY STATE DYNAMICS; HEAT TRANSFER; SOLUTION TECHNIQUE;
    COUPLED TEMPERATURE-DISPLACEMENT; UNCOUPLED TEMPERATURE-DISPLACEMENT; GREEN;
    COMPLEX FREQUENCY; CONTROLS; INTEGRATED OUTPUT; INTEGRATED OUTPUT SECTION;
    DIAGNOSTICS; SENSITIVITY; FILTER; VIEWFACTOR; USER OUTPUT VARIABLES
"""


def _split_words(text: str) -> frozenset[str]:
    return frozenset(_without_blanks(word) for word in text.split(";"))


def _without_blanks(keyword: str) -> str:
    """CalculiX reads keywords without their blanks."""
    return "".join(keyword.split()).upper()


WITHOUT_EFFECT = _split_words(
    ";".join((_SUPPORTS, _BEYOND_ELASTIC, _DEFINITIONS, _OUTPUT))
)
_DAMPING = _split_words("DAMPING; MODAL DAMPING; GLOBAL DAMPING; STRUCTURAL DAMPING")
#: Alternative for elements and materials that sidtool does not have.
BY_CALCULIX = 'geometry.engine = "calculix", which lets CalculiX discretise the deck'
#: Alternatives to refused keywords; unknown keywords are refused as well.
_ALTERNATIVES = {
    _without_blanks(keyword): advice
    for keyword, advice in {
        "CYCLIC SYMMETRY MODEL": "a mesh of the whole body",
        "NONSTRUCTURAL MASS": "densities that hold all mass",
        "SPRING": "a force in the scene between markers",
        "DASHPOT": "a force in the scene between markers",
        "MODEL CHANGE": "a deck of the elements that are there",
        "CONTACT PAIR": "one body without contact",
        "EMBEDDED ELEMENT": "one mesh whose nodes are merged",
        **dict.fromkeys(("BEAM SECTION", "NORMAL"), BY_CALCULIX),
        **dict.fromkeys(("BEAM GENERAL SECTION", "NODAL THICKNESS"), BY_CALCULIX),
        **dict.fromkeys(("MEMBRANE SECTION", "TRUSS SECTION"), BY_CALCULIX),
    }.items()
}
#: Keywords that are read if only the nodes, their names and masses are requested.
_NAMING = _split_words(
    "NODE; ELEMENT; NSET; ELSET; PART; END PART; ASSEMBLY; END ASSEMBLY; INSTANCE; "
    "END INSTANCE; SYSTEM; NGEN; NFILL; NCOPY; ELGEN; ELCOPY; MASS; ROTARY INERTIA"
)


class UnreadKeyword(InputError):
    """Error of a keyword that `geometry.ignore` may ignore."""


def keyword_effect(block: Block, ignored: frozenset[str], in_step: bool = False) -> str:
    """Return the effect of a keyword.

    It is "read", "damping", "ignored", "step", "without effect" or, where that is
    ignored, "left out".

    Parameters
    ----------
    ignored : keywords that the model file ignores on purpose, in capitals
    in_step : whether it is between *STEP and *END STEP: loads and output, unless
        it is known to change the body

    Raises
    ------
    InputError : the keyword changes the body, or is not known.
    """
    squeezed = _without_blanks(block.keyword)
    of_step = in_step and squeezed not in {*_ALTERNATIVES, *_READ}
    if squeezed in {_without_blanks(word) for word in ignored}:
        return "left out" if of_step or squeezed in WITHOUT_EFFECT else "ignored"
    if ONLY_NODES in ignored and squeezed not in _NAMING:
        return "ignored"
    if squeezed in _READ:
        return "read"
    if of_step:
        return "step"
    if squeezed in _DAMPING:
        return "damping"
    if squeezed in WITHOUT_EFFECT:
        return "without effect"
    advice = _ALTERNATIVES.get(squeezed)
    what = "is not supported" if advice else "is not known"
    raise UnreadKeyword(
        f"*{block.keyword} {what}",
        place=block.place,
        expected=f"{advice or 'a deck without it'}; geometry.ignore = "
        f'["{block.keyword}"] leaves it out',
    )


def spelled_out(block: Block) -> Block:
    """The block with its keyword and parameters spelled in full.

    Raises
    ------
    InputError : it has a parameter that is not known here.
    """
    keyword = _READ[_without_blanks(block.keyword)]
    allowed = READ[keyword]
    options = {}
    for name, value in block.options.items():
        plain = _without_blanks(name)
        fitting = [word for word in allowed if _without_blanks(word) == plain] or [
            word
            for word in allowed
            if _without_blanks(word).startswith(plain)
            and len(plain) >= _MIN_ABBREVIATION
        ]
        if keyword.endswith("STEP"):
            continue
        if len(fitting) != 1:
            raise InputError(
                f"*{keyword} has the parameter {name}, which is not supported",
                place=block.place,
                expected=f"among {', '.join(allowed) or 'none'}",
            )
        options[fitting[0]] = value
    return Block(keyword, options, block.place, block.lines)


_READ = {_without_blanks(keyword): keyword for keyword in READ}
