"""Forces between markers: theory, section 8.

A force acts on a scalar measure of the motion of two markers, a file for each, by a
law. A measure says its value, its rate and its wrench: the force on marker B, whose
reverse acts on A, the torque on A, that on B; and what the motion of the markers
changes in its rate.
"""
