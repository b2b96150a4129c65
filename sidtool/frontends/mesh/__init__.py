"""Meshes of solid elements, their points, faces and moments."""
