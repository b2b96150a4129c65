"""CalculiX as an engine for what own elements do not cover."""
