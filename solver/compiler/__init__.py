"""Compilation of kernels, in reading order.

- `types`: types of numbers, and signatures
- `vectors`: kernel value types: vectors, rotations, symmetric matrices
- `arrays`: rows of 2-D arrays as values
- `records`: named fields of array rows
- `tables`: tables of arrays and numbers that kernels receive as one argument
- `inner_kernels`: kernels that are called by kernels only
- `targets`: processors that machine code is made for
- `kernels`: machine code of a kernel; entry kernels that Python calls
- `kernel_cache`: compiled kernels on disk
- `precompile`: compiles all kernels before they are needed
- `lowering`: what numba makes of kernels, imported where one is compiled
"""
