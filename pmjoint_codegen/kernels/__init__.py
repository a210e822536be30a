"""The generated kernels as functions of arrays: compiled, or interpreted where no compiler is found."""
