"""Analyses of a compiled scene that do not integrate its motion.

static        static equilibrium
linear        linearisation about a state: frequencies, damping ratios, mode shapes
inverse       forces of a mechanism whose whole motion is prescribed
"""
