"""One simulation run, in reading order.

- `recorder`: rows of the result
- `run_loop`: step loop over the smooth intervals, events and friction between them
- `result`: result of a run and its notes
- `simulate`: function `simulate`
- `replay`: outputs of a finished run
"""
