"""What must hold of a scene beyond the types of its keys."""
