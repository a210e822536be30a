"""Trajectories as files for other people's tools: one record, one writer a format."""
