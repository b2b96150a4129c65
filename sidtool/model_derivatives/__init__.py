"""Derivatives of the SID of a model by its design variables.

design_variables      keys, parameters and shape variables as directions in the numbers
sid_derivatives       a SID with its derivatives by a complex step, its quantities
"""
