"""Nastran bulk data (.bdf, .nas, .dat).

bulk_data            reading of a file, card by card
cards                cards, fields and continuations
content              contents of bulk data, coordinate systems, node order
properties           properties of solids and shells, materials
bars, bar_sections   bars and their cross-sections
constraints          couplings, multi-point constraints
masses               masses at nodes
shells               shells as a deck for CalculiX
"""
