"""Identities that the blocks of every body keep."""
