"""Small models with one physical mistake each, and what has to be said of it."""

from . import bodies, joints, loads, machines, units
from .gallery import MISTAKES

__all__ = ["MISTAKES", "bodies", "joints", "loads", "machines", "units"]
