"""Functional mock-up units (FMI 2.0 and 3.0) of scenes and of linearised scenes.

The shared library of a unit holds the compiled kernels of sidtool, the tables of the
scene as constant data, and C of this package. It needs no Python at run time. Modules:

- `supported`: what of a scene a unit can do; refuses the rest by name
- `plant_table`: all tables and arrays of a unit as one table
- `c_source`: the generated header, between the tables and the C sources
- `linking`: the shared library, by `cc` or by `ziglang`
- `model_description`: modelDescription.xml
- `export`: all of it, to the file

`plant.c` advances the scene and evaluates its outputs, `lapack.c` factors large blocks;
`linear_plant.c` advances a linearised one. `unit.c`, `fmi2.c` and `fmi3.c` are the
functions of the standard for co-simulation, `exchange.c`, `exchange2.c` and
`exchange3.c` those of linearised scenes for model exchange.
"""
