"""Readers of meshes, patches and matrices of other programs.

mesh_files           choice of a reader, parts of a mesh, names in a deck
abaqus, nastran, ansys   one package for each program
gmsh                 Gmsh meshes
matrices, matrix_market   mass and stiffness matrices
nurbs_files          NURBS patches
openfast         blades and towers of ElastoDyn and BeamDyn as tables of stations
calculix_quadratic, calculix_engine   CalculiX as an engine
"""
