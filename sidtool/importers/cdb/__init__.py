"""ANSYS archives (.cdb)."""
