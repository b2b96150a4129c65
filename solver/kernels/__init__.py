"""Compiled kernels: plain loops over flat arrays, one signature each, no allocation."""
