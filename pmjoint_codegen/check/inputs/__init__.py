"""Where generated code is looked at: points for kernels, settings for runs."""
