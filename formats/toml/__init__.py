"""TOML files: reading, validation by classes, writing."""
