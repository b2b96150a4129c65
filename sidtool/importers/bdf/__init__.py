"""Nastran bulk data (.bdf, .nas, .dat)."""
