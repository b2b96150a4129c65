"""The Python interface: Model, Scene, Result and the functions of a script.

operations       convert, validate, simulate, compare
prepared_scene   changes, choice of the model and compilation before a run
interrupts       Ctrl-C and SIGTERM during a run
scene            Model and Scene; reading of files
result           Result of a simulation
compiled_scene   a scene compiled once and run with other numbers, in several threads
analyses         equilibrium, natural modes, inverse dynamics, Campbell diagrams
bodies           superelements, and files of bodies for other programs
state_space      state space and frequency response
motion_problem, cached_problem   values and derivatives, for the next ones
linearised_point  derivatives from one linearised run
sensitivity, optimise, identify   derivatives, best designs, numbers from measurements
study            error over cost, and sweeps of design parameters
tables           classes of the tables of scenes and models
"""
