"""The equations of motion: compiled kernels, plain loops without allocation."""
