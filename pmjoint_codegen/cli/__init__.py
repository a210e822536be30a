"""The command line: one module a command, each of which imports what is heavy only when it runs."""
