"""Writing files, whole or not at all and piece by piece; keeping what was found."""
