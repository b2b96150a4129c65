"""Other programs on the same SID and scene. None is required."""
