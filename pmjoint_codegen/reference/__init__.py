"""References as data: steps, ramps, trapezoids, tables and files in place of an expression of t.

columns   a CSV file -> columns by name, in a wanted unit
reader    a table of a model file, or a Python object -> `command.Command`
command   the unfiltered command: points in time, and what holds between them
spline    coefficients of the interpolating spline that is smooth enough for the law
segments  a command, filtered or not -> coefficients of y_r between break points, for the kernels
"""
