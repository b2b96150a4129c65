"""From a scene and its SIDs to the arrays of the kernels, in reading order.

SIDs and bodies:

- `sid_terms`, `stiffening`: terms of a SID, in the plane and in space
- `sid_packing`, `rotated_markers`, `body_data`: data of a body
- `errors`: input errors with the name of a scene entry

Joints and drives:

- `joints`, `constraint_table`
- `body_table`: frames that joints and drives prescribe
- `joint_friction`: joints with friction, rotations counted over full turns

Forces and laws:

- `force_rows`, `force_table`, `sensors`, `control_laws`
- `newton_pattern`: structure of the Newton matrix

The system:

- `build_inputs`, `build`: the compiled scene
- `system`: class `System`
- `update`: a system with other parameters of the same structure
- `characteristic_sizes`: lengths and sizes for relative errors
- `work_arrays`: work arrays of a run; evaluation of one state
"""
