"""From a scene and its SIDs to the arrays of the kernels, in reading order.

SIDs and bodies:

- `rotations`, `sid_terms`, `stiffening`, `body_damping`, `planar_reduction`
- `body_data`, `rotated_markers`, `sid_packing`: data of a body
- `errors`: input errors with the name of a scene entry

Joints and drives:

- `joints`, `constraints`, `constraint_table`, `constant_rates`
- `body_frames`, `body_table`: frames that joints and drives prescribe
- `joint_friction`: joints with friction

Forces and laws:

- `force_rows`, `force_table`, `matrix_forces`, `sensors`, `control_laws`
- `rotation_counters`: rotations counted over full turns
- `newton_pattern`: structure of the Newton matrix

The system:

- `build_inputs`, `build`: the compiled scene
- `system`: class `System`
- `update`: a system with other parameters of the same structure
- `characteristic_sizes`: lengths and sizes for relative errors
- `work_arrays`: work arrays of a run; evaluation of one state
"""
