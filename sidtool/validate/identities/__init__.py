"""Identities that the blocks of every body keep; importing them registers them."""

from . import content as content
from . import kinematic as kinematic
from . import mass as mass
from . import order as order
