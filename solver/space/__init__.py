"""Plane and space: their algebra, coordinates, and the arrays that kernels share."""
