"""Mesh data: nodes, elements, materials, couplings, shape functions, quadrature.

mesh                 nodes, blocks of elements, node sets
reference_elements   shape functions of the reference elements
quadrature_rules     quadrature on the reference elements
quadratic_fields     deformations by quadratic displacement fields
materials            anisotropic materials
connections          bars, shells, ties, couplings, equations of a mesh file
imported_mesh        content of a mesh file of any program
deck_text            lines and numbers of mesh files, included files, refusals
element_nodes        repeated nodes, missing mid-side nodes
unit_systems         unit systems and conversion of a SID
"""
