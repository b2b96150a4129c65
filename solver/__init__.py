"""What moves SIDs: bodies, joints, drives, forces, assembly, integrators."""
