"""Derivatives of the SID of a model by its design variables.

design_variables      keys, parameters and shape variables as directions in the numbers
quantities            mass, frequencies, inertia and compliance of a SID
sid_with_derivatives  a SID and its derivatives, in memory and in a file
sid_derivatives       the derivative of every block by a complex step
"""
