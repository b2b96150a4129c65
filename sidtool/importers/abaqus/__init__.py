"""Abaqus and CalculiX input files (.inp).

input_file        reading of a file, keyword by keyword; generated nodes and elements
keywords          keyword blocks, and the effect of each keyword
deck              contents of a deck, sets, supported element types
materials         elastic materials and orientations
instances         instances of parts as one body
surfaces          surfaces and the coordinate system of nodes
couplings         rigid and distributing couplings, masses
equations         equations, multi-point constraints, ties
mesh              mesh and shells of a deck
"""
