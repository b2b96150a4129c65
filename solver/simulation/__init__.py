"""One simulation run, in reading order.

- `simulate`: function `simulate`, the five steps of a run
- `preparation`: start, plan of the outputs, arrays
- `recorder`: rows of the result
- `run_loop`: step loop over the smooth intervals, events and friction between them
- `result`: result of a run and its notes
- `frozen_run`: runs with the steps of another run
- `position_rates`, `linearised_run`: a frozen run linearised about itself, eq. (46)
- `motion_derivatives`: its direct and adjoint derivatives by numbers of the scene
- `floquet`: multipliers of a periodic motion, eq. (50)
- `plant`, `input_pieces`: a scene that a program advances to given times
- `replay`: outputs of a finished run
"""
