"""Primitive constraints between two markers, a file for each: theory, section 7.

A primitive of one row says in `evaluate` its value, rate and right-hand side, and its
wrench: the force on marker B, whose reverse acts on A, the torque on A, that on B. In
`linearise` it says what the motion of the markers changes in its acceleration, and
adds to Rp what their bodies change in its forces.
"""
