"""Output quantities, energies, dense output and events, in reading order.

- `samples`: kinematics, accelerations and multipliers of recorded states
- `body_outputs`: motion, momenta and stresses of bodies and markers
- `section_forces`: section forces of bodies
- `reactions`: forces and torques of joints, drives and forces
- `energies`: energies, powers and their integrals
- `columns`: columns of a result by their names
- `dense_output`: states between the ends of steps
- `events`: events
- `stick_slip`: stick and slip of joints with friction
- `resume`: state from which a run is continued
"""
