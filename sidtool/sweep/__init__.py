"""Design parameters: a scene for every combination of values of its keys.

axes        keys and their values
measures    numbers of the time history of an output
design      scenes and models of all points
outcome     what was found, as a table of columns, text, CSV and picture
asked       all of it as a command line or a script asks for it
"""

from __future__ import annotations

from .asked import sweep
from .outcome import Sweep, SweepPoint

__all__ = ["Sweep", "SweepPoint", "sweep"]
