"""Mass and stiffness matrices of other programs."""
