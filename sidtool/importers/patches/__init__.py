"""NURBS patches of other programs."""
