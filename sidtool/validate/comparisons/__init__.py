"""Comparison of two SIDs, or of a SID with a table."""
