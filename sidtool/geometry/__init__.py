"""B-splines and NURBS patches.

nurbs_patch        B-splines, NURBS patches, degree elevation, knot insertion
multipatch         patches joined along matching sides
patch_contact      patches that meet without a seam
patch_evaluation   inverse mapping, volume and centre of a patch
cylinder_fit       circle or cylinder through points
"""
