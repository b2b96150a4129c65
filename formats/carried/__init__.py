"""What the shape functions of a body carry of the static compliance of the full one."""

from .shares import DIRECTIONS, Carried, Six, carried_from_text

__all__ = ["DIRECTIONS", "Carried", "Six", "carried_from_text"]
