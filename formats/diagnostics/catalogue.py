"""All diagnostics by code."""

from . import (
    accuracy,
    analyses,
    conversion,
    files,
    identities,
    run,
    scene,
)
from .entry import Entry

#: Subject of the codes of each hundred.
GROUPS = {
    "N1": "Model and conversion",
    "N2": "Scene, units and start",
    "N3": "Run and integration",
    "N4": "Validity: small deformations and shape functions",
    "N5": "Friction, force laws and control laws",
    "N6": "Export to other programs, accuracy on request",
    "N7": "Static equilibrium, natural modes, inverse dynamics and studies",
    "N8": "Files and pictures",
    "N9": "Identities, units and comparison of SIDs",
}

#: Entry of each code.
CATALOGUE: dict[str, Entry] = {}
for _module in (
    conversion,
    run,
    scene,
    files,
    accuracy,
    analyses,
    identities,
):
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
