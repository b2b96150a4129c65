"""From many degrees of freedom to a few shape functions."""
