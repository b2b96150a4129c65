"""What the keywords of Abaqus and CalculiX mean for a linear elastic body.

Every keyword of a deck is read, listed as without effect, or refused by name: nothing
is passed over in silence, and what is not known is refused.
"""

from __future__ import annotations

from sidtool.formats.errors import InputError

from ..imported import EVERYTHING
from .blocks import Block

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
#: Loads and supports: the model file says where a body is held and loaded.
_SUPPORTS = """
    BOUNDARY; CLOAD; DLOAD; DSLOAD; TEMPERATURE; FILM; RADIATE; CFLUX; DFLUX; SFILM;
    INITIAL CONDITIONS; BASE MOTION; AMPLITUDE; INERTIA RELIEF; CONNECTOR MOTION;
    CONNECTOR LOAD; FIELD
"""
#: Further material data, which a linear elastic body does not ask for.
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
#: What is computed and written; a deck may say it outside its steps.
_OUTPUT = """
    RESTART; NODE PRINT; EL PRINT; NODE FILE; EL FILE; CONTACT PRINT; CONTACT FILE;
    SECTION PRINT; OUTPUT; NODE OUTPUT; ELEMENT OUTPUT; ENERGY OUTPUT; ENERGY PRINT;
    CONTACT OUTPUT; MONITOR; FILE FORMAT; FILE OUTPUT; STATIC; FREQUENCY; DYNAMIC;
    BUCKLE; MODAL DYNAMIC; STEADY STATE DYNAMICS; HEAT TRANSFER; SOLUTION TECHNIQUE;
    COUPLED TEMPERATURE-DISPLACEMENT; UNCOUPLED TEMPERATURE-DISPLACEMENT; GREEN;
    COMPLEX FREQUENCY; CONTROLS; INTEGRATED OUTPUT; INTEGRATED OUTPUT SECTION;
    DIAGNOSTICS; SENSITIVITY; FILTER; VIEWFACTOR; USER OUTPUT VARIABLES
"""


def _listed(text: str) -> frozenset[str]:
    return frozenset(_squeezed(word) for word in text.split(";"))


def _squeezed(keyword: str) -> str:
    """CalculiX reads keywords without their blanks."""
    return "".join(keyword.split()).upper()


WITHOUT_EFFECT = _listed(";".join((_SUPPORTS, _BEYOND_ELASTIC, _DEFINITIONS, _OUTPUT)))
_DAMPING = _listed("DAMPING; MODAL DAMPING; GLOBAL DAMPING; STRUCTURAL DAMPING")
#: What has no element or law of our own.
BY_CALCULIX = 'geometry.engine = "calculix", which lets CalculiX discretise the deck'
#: Refused with what would do instead; what is not known is refused as well.
_INSTEAD = {
    _squeezed(keyword): advice
    for keyword, advice in {
        "CYCLIC SYMMETRY MODEL": "a mesh of the whole body",
        "DISTRIBUTING COUPLING": "a marker with a distributing tie",
        "NONSTRUCTURAL MASS": "densities that hold all mass",
        "SPRING": "a force in the scene between markers",
        "DASHPOT": "a force in the scene between markers",
        "MODEL CHANGE": "a deck of the elements that are there",
        "CONTACT PAIR": "one body without contact",
        "EMBEDDED ELEMENT": "one mesh whose nodes are merged",
        **dict.fromkeys(("SHELL SECTION", "BEAM SECTION", "NORMAL"), BY_CALCULIX),
        **dict.fromkeys(("BEAM GENERAL SECTION", "NODAL THICKNESS"), BY_CALCULIX),
        **dict.fromkeys(("MEMBRANE SECTION", "TRUSS SECTION"), BY_CALCULIX),
    }.items()
}
#: What is read where only the nodes, their names and masses are asked for.
_NAMING = _listed(
    "NODE; ELEMENT; NSET; ELSET; PART; END PART; ASSEMBLY; END ASSEMBLY; INSTANCE; "
    "END INSTANCE; SYSTEM; NGEN; NFILL; NCOPY; ELGEN; ELCOPY; MASS; ROTARY INERTIA"
)
#: Shortest abbreviation of a parameter.
_SHORTEST = 3


class UnreadKeyword(InputError):
    """A keyword that `geometry.ignore` may leave out."""


def kind_of(block: Block, ignored: frozenset[str], in_step: bool = False) -> str:
    """ "read", "damping", "ignored", "step", "without effect" or, where that is
    ignored, "left out".

    Parameters
    ----------
    ignored : keywords that the model file leaves out on purpose, in capitals
    in_step : whether it stands between *STEP and *END STEP: loads and output, unless
        it is known to change the body

    Raises
    ------
    InputError : the keyword changes the body, or is not known.
    """
    squeezed = _squeezed(block.keyword)
    of_step = in_step and squeezed not in {*_INSTEAD, *_READ}
    if squeezed in {_squeezed(word) for word in ignored}:
        return "left out" if of_step or squeezed in WITHOUT_EFFECT else "ignored"
    if EVERYTHING in ignored and squeezed not in _NAMING:
        return "ignored"
    if squeezed in _READ:
        return "read"
    if of_step:
        return "step"
    if squeezed in _DAMPING:
        return "damping"
    if squeezed in WITHOUT_EFFECT:
        return "without effect"
    advice = _INSTEAD.get(squeezed)
    what = "is not supported" if advice else "is not known"
    raise UnreadKeyword(
        f"*{block.keyword} {what}",
        place=block.place,
        expected=f"{advice or 'a deck without it'}; geometry.ignore = "
        f'["{block.keyword}"] leaves it out',
    )


def readable(block: Block) -> Block:
    """The block with its keyword and parameters spelled in full.

    Raises
    ------
    InputError : it has a parameter that is not known here.
    """
    keyword = _READ[_squeezed(block.keyword)]
    allowed = READ[keyword]
    options = {}
    for name, value in block.options.items():
        plain = _squeezed(name)
        fitting = [word for word in allowed if _squeezed(word) == plain] or [
            word
            for word in allowed
            if _squeezed(word).startswith(plain) and len(plain) >= _SHORTEST
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
    return Block(keyword, options, block.place, block.rows)


_READ = {_squeezed(keyword): keyword for keyword in READ}
