"""Functions of time: polynomials in pieces, harmonics, tables and Python callables."""
