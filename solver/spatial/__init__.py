"""Algebra and coordinates of plane and space, in reading order.

- `dimension`: fields of the array rows in plane and in space
- `system_arrays`: constants, columns and arrays that the kernels read and write
- `algebra`: vectors, rotations and inertia in plane and space
- `coordinates`: positions z_I, velocities z_II and the tangent space of z_I
"""
