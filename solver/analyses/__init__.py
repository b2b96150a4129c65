"""Analyses of a mechanism besides the simulation, in reading order.

- `dense_equations`: equations of motion with dense matrices
- `joint_friction`: equations with sticking joints
- `frozen_inputs`: systems whose inputs are held constant
- `static_equilibrium`, `initial_equilibrium`: static equilibrium
- `rotating_groups`, `steady_rotation`: steady rotation
- `reference_axes`: axes in which small motions are seen
- `power_laws`, `state_derivatives`: derivatives of forces by differences, and limits of
  those that fall slowly with their step
- `multi_blade`: equal bodies around an axis (Coleman transformation)
- `state_matrix`, `steady_axes`, `rigid_motions`, `whirl`, `linearisation`: natural
  modes, eq. (23)
- `state_space`, `input_effects`, `output_derivatives`, `state_space_forms`: state space
  between inputs and outputs
- `frequency_response`: response of a state space to harmonic inputs
- `inverse_dynamics`: forces of drives for a prescribed motion
- `analysis_results`: results of the analyses
"""
