"""Bodies of a scene as tables: the data of their SIDs, frames, variants of a body."""
