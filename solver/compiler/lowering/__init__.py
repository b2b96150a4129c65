"""What numba makes of kernels; imported when one is compiled, in reading order.

- `numba_types`: types of kernels as types of numba
- `memory`, `vectors`: machine code of what kernels see
- `fast_lowering`: translations of operations that compile faster than those of numba
- `units`: kernels alone, calls of kernels, and object files
"""
