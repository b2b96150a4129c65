"""Long runs: few of them go to their end.

part      choices in the first part of the motion
sparing   a few runs of all of the time, where no first part does
whole     the reference, one run of all of the time
"""

from .part import chosen_in_part
from .whole import Proven

__all__ = ["Proven", "chosen_in_part"]
