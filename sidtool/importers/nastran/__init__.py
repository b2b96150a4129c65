"""Nastran bulk data (.bdf, .nas, .dat).

bulk_data            reading of a file, card by card
cards                cards, fields and continuations
content              contents of bulk data, cards without effect, node order
coordinate_systems   coordinate systems
properties           properties of solids and shells, materials
bars, bar_sections   bars and their cross-sections
constraints          couplings, multi-point constraints
masses               masses at nodes
shells               shells as a deck for CalculiX
"""
