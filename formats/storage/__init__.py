"""Storage: atomic and incremental writing, HDF5 files, caches, operating systems."""
