"""Design parameters: a scene for every combination of values of its keys.

design         keys and their values, scenes and models of all points
sweep_result   measures of outputs, table of all points, as text, CSV and picture
"""

from .sweep_result import Sweep, SweepPoint

__all__ = ["Sweep", "SweepPoint"]
