"""Co-simulation units (FMI 2.0 and 3.0) of the exported controller and of the simulated plant.

variables.py     what a unit's variables are, and the C that reaches them by value reference
units.py         their physical units in SI base units
controller.py    the exported C as a unit
plant.py         the simulated plant as a unit, printed from the derivation
description.py   modelDescription.xml and buildDescription.xml
archive.py       sources and binaries in one file
loop.py          both units in one loop in FMPy, in a process of its own
"""
