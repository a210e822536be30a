"""Inputs of the checks: points for kernels, settings for runs."""
