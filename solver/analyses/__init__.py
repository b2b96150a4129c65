"""Analyses of a mechanism besides the simulation, in reading order.

- `dense_equations`: equations of motion with dense matrices
- `joint_friction`: equations with sticking joints
- `frozen_inputs`: systems whose inputs are held constant
- `static_equilibrium`, `initial_equilibrium`: static equilibrium
- `rotating_groups`, `steady_rotation`: steady rotation
- `reference_axes`, `rotated_shapes`: axes in which small motions are seen
- `state_matrix`, `rigid_motions`, `whirl`, `linearisation`: natural
  modes, eq. (23)
- `inverse_dynamics`: forces of drives for a prescribed motion
- `analysis_results`: results of the analyses
"""
