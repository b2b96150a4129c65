"""Readers of meshes, patches and matrices that other programs wrote."""
