"""Linear systems of the equations of motion, in reading order.

- `block_factors`: LU factors of the blocks of bodies
- `mass_matrix`: factors of the mass matrix and of its Schur complement
- `saddle_point`: saddle-point systems of constraints
- `factor_storage`: factors and vectors of one run
- `joint_friction`: friction forces of joints, stick constraints
- `accelerations`: accelerations and multipliers of a state, eq. (3)
- `newton_matrix`: Newton matrices of the implicit integrators
- `driven_joint_reactions`: reactions of joints with prescribed frames
"""
