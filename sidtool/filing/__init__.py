"""Runs as pages that engineers file."""
