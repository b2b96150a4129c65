"""What is recorded of a run: sampled states, outputs, forces, energies, events."""
