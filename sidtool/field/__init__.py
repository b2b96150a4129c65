"""Full displacement and stress field of a body, and its surface for pictures.

sampled_points   points of a discretised body and their motion
mesh_field       fields of meshes and NURBS patches
body_field       field of a reduced body
surface          surfaces of plane bodies and of bodies without a known surface
body_surfaces    surfaces of all bodies of a scene
"""
