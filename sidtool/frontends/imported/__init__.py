"""Bodies that other programs meshed or discretised."""
