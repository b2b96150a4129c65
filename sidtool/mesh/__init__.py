"""Mesh data: nodes, elements, materials, couplings, shape functions, quadrature.

mesh                 nodes, blocks of elements, node sets
reference_elements   shape functions and quadrature of the reference elements
jacobians            Jacobian matrices, their determinants and adjugates
quadratic_fields     deformations by quadratic displacement fields
materials            anisotropic materials
connections          bars, shells, ties, couplings, equations of a mesh file
imported_mesh        content of a mesh file of any program, missing mid-side nodes
deck_text            lines and numbers of mesh files, included files, refusals
unit_systems         unit systems and conversion of a SID
"""
