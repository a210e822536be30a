"""Ratios to public tools, measured side by side in one process run: `make bench`."""
