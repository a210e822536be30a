"""A page that runs the closed loop in a browser."""
