"""Functions of time and control laws, in reading order.

- `chebyshev`: piecewise Chebyshev series of a function
- `kink_positions`: times at which a derivative jumps
- `callables`: callables of a program as functions of time or as native functions
- `piecewise`: piecewise polynomials of formulas and tables, features no step may skip
- `function_table`: all functions of a scene as rows of one table
- `control_laws`: instructions of a control law
- `law_derivatives`: derivatives in time of the value of a law
"""
