"""Sparse factorisation and lowest eigenpairs, in one or several processes.

eigenpairs      lowest eigenpairs of K v = lambda M v
lanczos         block Lanczos in shift-invert mode
projected_matrix
                matrices of reduced coordinates, as products
factorisation   sparse Cholesky and LU factors, ordering, memory
pardiso         Cholesky factors by Intel's oneMKL
multigrid       responses and modes of large solids without factors
slepc           several processes; the engine and listener of a run
"""
