"""Beams: axis, cross-section, element, mass.

axis                 straight or curved axis
cross_section        properties and stiffness of a section
profiles             values that vary along the axis
element              beam element from the exact static solution
integration_points   points that carry mass and stiffness
beam_model           the discretised body
"""
