"""Beams: axis, cross-section, element, mass.

axis            straight or curved axis
cross_section   properties and stiffness of a section, values along the axis
element         beam element from the exact static solution, integration points
beam_model      the discretised body
"""
