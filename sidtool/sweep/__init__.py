"""Design parameters: a scene for every combination of values of its keys.

axes           keys and their values
measures       numbers of the time history of an output
design         scenes and models of all points
sweep_result   table of all points, as text, CSV and picture
"""

from __future__ import annotations

from .sweep_result import Sweep, SweepPoint

__all__ = ["Sweep", "SweepPoint"]
