"""Full displacement and stress field of a body, and its surface for pictures.

body_field      points, faces, motion and stresses of a reduced body
surface         surfaces of plane bodies and of bodies without a known surface
body_surfaces   surfaces of all bodies of a scene, shapes of rigid ones
"""
