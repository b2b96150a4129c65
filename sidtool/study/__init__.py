"""Error against time and size: variants of a scene beside its richest one.

settings    integrators, tolerances and steps
measuring   runs of compiled scenes, timed
reference   the motion that errors are measured against, and how far they can be told
points      what a variant costs and gives; the Pareto front
axes        what is varied: meshes, modes, reductions, frames, terms, integrators
bodies      models and SIDs of bodies in all their variants
plan        the points of a study and the outputs that it compares
tasks       what one process does
kept        finished points, by content
pool        all cores, or a cluster
finest      the richest variant
whole       all of it
outcome     what was found, with its fronts, tables and pictures
asked       all of it as a command line or a script asks for it
tables      as text, as CSV and as a file
"""

from __future__ import annotations

from .axes import parsed
from .measuring import Course, is_hopeless, timed
from .outcome import Study
from .points import Point, front, measure, point_of, recommended
from .pool import Ended
from .reference import Reference, StoppedEarly, make_reference, moves
from .settings import Setting, default_settings
from .whole import study

__all__ = [
    "Course",
    "Ended",
    "Point",
    "Reference",
    "Setting",
    "StoppedEarly",
    "Study",
    "default_settings",
    "front",
    "is_hopeless",
    "make_reference",
    "measure",
    "moves",
    "parsed",
    "point_of",
    "recommended",
    "study",
    "timed",
]
