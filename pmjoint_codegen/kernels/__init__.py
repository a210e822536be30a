"""The generated kernels as functions of arrays: compiled, or interpreted if no compiler is found."""
