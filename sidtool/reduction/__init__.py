"""Reduction methods, body frames, the reduced basis and its error.

body_frames        tangent, chord and mean-axis (Buckens) frames
admissible_space   displacements allowed by frame, ties and supports
methods            reduction methods, shape functions from a file
reduced_basis      orthonormal basis of the candidates
basis_error        error of a basis against the full mesh
"""
