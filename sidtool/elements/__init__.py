"""Finite element model of a body: solid elements, markers, surfaces, ties.

finite_element_model   the discretised body that every discretisation yields
material_points        strains and stresses at quadrature points
solid_elements         stiffness and mass, reduced integration, incompatible modes
matrix_sums            element matrices added up in sparse ones
solid_mesh             matrices of a mesh, inertia of incompatible modes
markers                rows of markers in meshes and patches
faces                  surfaces, faces and their common parts
plane_cuts             mass beyond a plane, and the section in it
mass_properties        mass and centre of meshes
mortar_ties            surfaces tied by the mortar method
mesh_contact           overlaps, hanging nodes, conformity
"""
