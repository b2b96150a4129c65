"""Generalised-alpha, with its error estimate."""
