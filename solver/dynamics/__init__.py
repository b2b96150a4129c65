"""Equations of motion: compiled kernels without allocation, in reading order.

Kinematics:

- `body_frames`: frames of the bodies
- `markers`: motion of the markers on deformed bodies, eq. (5)-(7)
- `drives`: functions of time

Bodies:

- `body`: mass matrix and forces of a body, eq. (10)-(12)
- `geometric_stiffening`: inertia of stiffened bodies, section 12
- `body_derivatives`: derivatives of both

Constraints, eq. (14):

- `marker_forces`, `marker_force_derivatives`: forces on markers
- `constraint_rows`, `point_constraints`, `direction_constraints`, `constraints`

Forces, eq. (16):

- `force_characteristics`, `force_measures`, `applied_forces`, `force_law`
- `control_laws`: interpreter of the instructions of laws
- `forces`: all forces

The complete system:

- `equations_of_motion`: evaluation and linearisation of eq. (3)
- `output_quantities`: wrenches, energies and momenta of recorded states
"""
