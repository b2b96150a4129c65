"""One simulation run, in reading order.

- `simulate`: function `simulate`, the five steps of a run
- `preparation`: start, plan of the outputs, arrays
- `recorder`: rows of the result
- `stepping`: start of smooth intervals, change of the method; common to runs and plants
- `run_loop`: step loop over the smooth intervals, events and friction between them
- `result`: result of a run and its notes
- `plant`: a scene that a program advances to given times
- `replay`: outputs of a finished run
"""
