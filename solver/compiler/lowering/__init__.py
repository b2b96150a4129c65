"""Translation of kernels by numba; imported when one is compiled, in reading order.

- `numba_types`: types of kernels as types of numba
- `memory`, `vectors`: machine code of arrays, records, tables and vectors
- `fast_lowering`: translations of operations that compile faster than those of numba
- `units`: LLVM modules of single kernels, calls between them, and object files
"""
