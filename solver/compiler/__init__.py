"""Compilation of kernels, in reading order.

- `vectors`: kernel value types: vectors, rotations, symmetric matrices
- `arrays`: rows of 2-D arrays as values
- `records`: named fields of array rows
- `tables`: tables of arrays and numbers that kernels receive as one argument
- `fast_lowering`: translations of operations that compile faster than those of numba
- `inner_kernels`: kernels that are called by kernels only
- `kernels`: machine code of a kernel; entry kernels that Python calls
- `kernel_cache`: compiled kernels on disk
- `precompile`: compiles all kernels before they are needed
"""
