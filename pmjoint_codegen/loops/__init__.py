"""The loops: C in `c` and `c_batch`, and their Python twins with the same arithmetic in the same order."""
