"""Bodies of several patches, and ties between sides that do not match."""
