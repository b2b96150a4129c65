"""Beams: axis, section, element, mass."""
