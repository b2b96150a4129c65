"""The ASCII SID file: read in every known dialect, written in any of them."""

from .reader import read_ascii
from .writer import write_ascii

__all__ = ["read_ascii", "write_ascii"]
