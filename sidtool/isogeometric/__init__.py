"""Isogeometric analysis, and meshes sampled from patches.

iga               matrices of one refined patch
multipatch_iga    bodies of one or several patches, tied by the mortar method
sampled_patch     quadrilaterals, hexahedra and tetrahedra that sample a patch
"""
