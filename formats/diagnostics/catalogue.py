"""All diagnostics by code."""

from . import analyses, conversion, export, laws, run, scene, stops, validity
from .entry import Entry

#: Subject of the codes of each hundred.
GROUPS = {
    "N1": "Model and conversion",
    "N2": "Scene, units and start",
    "N3": "Run and integration",
    "N4": "Validity: small deformations and shape functions",
    "N5": "Friction, force laws and control laws",
    "N6": "Export to other programs",
    "N7": "Static equilibrium, natural modes and inverse dynamics",
}

#: Entry of each code.
CATALOGUE: dict[str, Entry] = {}
for _module in (conversion, scene, stops, run, validity, laws, export, analyses):
    for _entry in _module.ENTRIES:
        assert _entry.code not in CATALOGUE, _entry.code
        CATALOGUE[_entry.code] = _entry


def find_code(text: str) -> str:
    """Return the code that a user means: "n411", "N411" and "411" are the same.

    Raises
    ------
    KeyError : there is no such code.
    """
    code = "N" + text.strip().upper().removeprefix("N")
    if code not in CATALOGUE:
        raise KeyError(code)
    return code
