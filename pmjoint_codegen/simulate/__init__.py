"""Runs of the closed loop over the generated kernels; imports neither SymPy nor CasADi."""
