"""Derivatives of the SID of a model by its design variables.

design_variables   keys, parameters and shape variables as directions in the numbers
sid_derivatives    the derivative of every block by a complex step
"""
