"""Diagnostics N6xx: export of scenes to other programs."""

from .entry import INFO, Entry

ENTRIES = (
    Entry(
        "N601",
        INFO,
        "is an event that the FMU does not report",
        "An FMU has the motion of the scene. Events that only record a state change "
        "nothing of it and are left out. Events that end the run are refused.",
        remedy="Watch the output in the importing program.",
        example={"subject": "landing"},
    ),
    Entry(
        "N602",
        INFO,
        "is an input whose table is not in the FMU",
        "Inputs of an FMU are set by the importing program. Until then they have the "
        "value `initial` of the scene.",
        remedy="Give the table to the importing program.",
        example={"subject": "load"},
    ),
)
