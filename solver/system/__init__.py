"""From a scene and its SIDs to `System`, the tables that kernels read."""
