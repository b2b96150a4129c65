"""Linear algebra of constrained bodies: accelerations, projections, Newton's matrix."""
