"""Solid elements: shapes, quadrature, strains."""
