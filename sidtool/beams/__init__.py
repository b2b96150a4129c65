"""Beams: axis, cross-section, element, mass.

axis            straight or curved axis
cross_section   properties and stiffness of a section, values along the axis
section_shapes  properties of named cross-sections
station_section  sections from tables of stations
element         beam element from the exact static solution, integration points
stress_points   points of sections where the stress can be largest
beam_model      the discretised body
"""
