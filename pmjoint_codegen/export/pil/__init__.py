"""Processor in the loop: the exported controller on an emulated microcontroller, against this machine."""
