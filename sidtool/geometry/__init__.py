"""The shape of a part as an exact NURBS patch."""
