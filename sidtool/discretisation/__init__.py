"""From a model file to a finite element model.

registry               discretisations by geometry and discretisation type
mesh_body              bodies of a mesh file
matrices_body          bodies of imported matrices
bars_body, bar_elements, bar_nodes   bodies of bars and rods
imported_constraints   couplings, masses, equations, ties of a file
calculix_body          bodies that CalculiX discretises
marker_couplings       markers tied to many nodes (RBE2, RBE3)
"""
