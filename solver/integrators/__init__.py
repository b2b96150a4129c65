"""Time integration: step loops on compiled scenes, in reading order.

- `loop_state`: state of a step loop
- `step_size`: error norm, eq. (22), and choice of the next step
- `step_limits`: limits of a step by features of functions and forces
- `projection`: projection onto the constraints, eq. (18)
- `singular_configurations`: steps near singular configurations
- `output_sampling`: states at output times within a step
- `newton_iteration`, `implicit_loop`: parts common to the implicit methods
- `radau_stages`, `radau`: Radau IIA, eq. (19)
- `generalised_alpha_step`, `generalised_alpha`: generalised-alpha, eq. (21)
- `trapezoidal`: trapezoidal rule, eq. (20)
- `dop853_tableau`, `explicit_runge_kutta`: explicit method of order 8
- `batch_evaluation`: the equations at many states, and their derivatives
- `linearised_steps`: linearised steps of Radau methods, eq. (46) and (49)
- `registry`: all integrators, and the choice of one
"""
