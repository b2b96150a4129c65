"""Abaqus and CalculiX input files (.inp).

input_file        reading of a file, keyword by keyword
keywords          keyword blocks, and the effect of each keyword
deck              contents of a deck, sets, supported element types
materials         elastic materials and orientations
node_generation   generated nodes and elements
instances         instances of parts as one body
shells            sections of shells
surfaces          surfaces and the coordinate system of nodes
couplings         rigid and distributing couplings, masses
equations         equations, multi-point constraints, ties
mesh              mesh of a deck
"""
