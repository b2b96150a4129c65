"""Files in TOML: read, checked against their classes, written."""
