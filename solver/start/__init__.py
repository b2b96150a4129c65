"""Consistent initial conditions: assembly, redundant constraints, turns."""
