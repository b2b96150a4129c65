"""Pictures: shapes of a body, motions beside each other, work against precision."""
