"""From a discretised body to the blocks of its SID."""
