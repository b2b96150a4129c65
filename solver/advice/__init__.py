"""What a run says of its scene: checks, excitation, stiffening, causes of a stop."""
