"""From a model file to a finite element model.

registry               discretisations by geometry and discretisation type
mesh_body              bodies of a mesh file
matrices_body          bodies of imported matrices
bar_elements, bar_nodes  bars and rods, and the nodes at their ends
structure              assembly of bodies whose nodes turn
bars_body              bodies of bars and shells in a mesh file
frame_body             frames of beams in a model file
imported_constraints   couplings, masses, equations, ties of a file
calculix_body          bodies that CalculiX discretises
body_cuts              plane cuts through solid bodies
marker_couplings       markers tied to many nodes (RBE2, RBE3)
"""
