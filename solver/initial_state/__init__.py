"""Consistent initial conditions and redundant constraints, in reading order.

- `constraint_jacobian`: state with its constraint Jacobian and scaled coordinates
- `sparse_jacobian`: constraints of large scenes
- `given_state`: positions and velocities that the scene states, initial orientations
- `assembly`: positions and velocities that meet the constraints
- `contradictions`, `displacement_report`: why an assembly failed
- `redundant_constraints`, `overconstraint`: dependent constraints
- `initial_friction`: friction at the start
- `integrator_start`: settings of a run and initial state of the step loop
"""
